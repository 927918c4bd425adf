"""Wrong input: a table of arguments, each refused with words that name argument, value and cure."""

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
import wrong_inputs as w
from wrong_inputs import INF, NAN

# ruff: noqa: E501 - a table
settings = ff.StepSettings
pytestmark = pytest.mark.mpi
POINT, NORMAL = (0, 0), (0, 1)

# fmt: off
ROWS = [
    # friction coefficient
    ("mu None", lambda s: s.with_mu(None), "mu = None is None; give a number"),
    ("mu string", lambda s: s.with_mu("0.3"), "mu = '0.3' is of type str; give a number"),
    ("mu list", lambda s: s.with_mu([0.3]), r"mu = \[0.3\] is of type list"),
    ("mu tuple", lambda s: s.with_mu((0.3, 0.2)), "mu = .* is of type tuple"),
    ("mu dict", lambda s: s.with_mu({"mu": 0.3}), "mu = .* is of type dict"),
    ("mu array", lambda s: s.with_mu(np.array([0.3, 0.3])), "mu = array.* must be a number"),
    ("mu array of one", lambda s: s.with_mu(np.array([0.3])), "mu = array.* must be a number"),
    ("mu complex", lambda s: s.with_mu(0.3 + 0j), "mu = .* of type complex"),
    ("mu bool", lambda s: s.with_mu(True), "mu = True must be a number"),
    ("mu negative", lambda s: s.with_mu(-0.1), "mu = -0.1 must be >= 0"),
    ("mu nan", lambda s: s.with_mu(NAN), "mu = nan must be >= 0"),
    ("mu inf", lambda s: s.with_mu(INF), "mu = inf must be >= 0 and finite"),
    ("mu inf at a node", w.on_infinite_mu, r"inf at \(.*, where or beside which the Function f is inf"),
    ("mu vector", lambda s: s.with_mu(s.vector), r"mu must be scalar, its shape is \(2,\)"),
    ("mu constant vector", lambda s: s.with_mu(fem.Constant(s.mesh, (0.3, 0.3))), "must be scalar"),
    ("mu class", lambda s: s.with_mu(float), "mu = .* is the class float itself"),
    ("mu of another mesh", lambda s: s.with_mu(s.scalar(s.other)), "of another mesh; make it on"),
    ("mu of another surface", w.mu_of_another_surface, "of another mesh; make it on"),
    ("mu without values", lambda s: s.with_mu(ufl.Coefficient(s.scalar().function_space)), "no values"),
    ("mu() of one argument", lambda s: s.with_mu(lambda p: 0.3), "mu.pressure, sliding. raised TypeError"),
    ("mu() None", lambda s: s.with_mu(lambda p, s: None), "mu.pressure, sliding. returned None"),
    ("mu() string", lambda s: s.with_mu(lambda p, s: "0.3"), "returned '0.3'"),
    ("mu() vector", lambda s: s.with_mu(lambda p, s: s.x), r"an expression of shape \(2,\)"),
    ("mu() raises", lambda s: s.with_mu(lambda p, s: s.speed), "raised AttributeError.*'speed'"),
    ("mu() NumPy", lambda s: s.with_mu(lambda p, s: np.exp(p)), "raised TypeError"),
    # laws
    ("friction number", lambda s: s.with_law(0.3), "friction = 0.3 is of type float; give a law"),
    ("friction None", lambda s: s.with_law(None), "friction = None is None; give a law"),
    ("friction class", lambda s: s.with_law(ff.Frictionless), "the class Frictionless itself"),
    ("friction string", lambda s: s.with_law("coulomb"), "friction = 'coulomb'"),
    ("adhesion None", lambda s: ff.Coulomb(0.1, adhesion=None), "adhesion = None"),
    ("adhesion nan", lambda s: ff.Coulomb(0.1, adhesion=NAN), "adhesion = nan must be >= 0"),
    ("cap string", lambda s: ff.Coulomb(0.1, cap="1"), "cap = '1'"),
    ("cap negative", lambda s: ff.Coulomb(0.1, cap=-1), "cap = -1 must be >= 0"),
    ("cap of another mesh", lambda s: s.with_law(ff.Coulomb(0.1, cap=s.scalar(s.other))), "another mesh"),
    ("limit None", lambda s: s.with_law(w.NoLimit()), "NoLimit.limit.* returned None"),
    ("limit vector", lambda s: s.with_law(w.VectorLimit()), "VectorLimit.limit.* of shape"),
    ("limit of one argument", lambda s: s.with_law(w.OneArgument()), "OneArgument.limit.* raised TypeError"),
    ("limit at 0", lambda s: s.with_law(w.UnboundedAtZero()), r"pressure 0 \(adhesion\) must be .* it is inf"),
    ("metric of 3D", lambda s: s.with_law(w.WrongMetric(0.3)), r"WrongMetric.metric.* shape \(3, 3\)"),
    ("row scalar", lambda s: s.with_law(w.ScalarRow(0.3)), "ScalarRow.row.* of shape"),
    ("orthotropic in 2D", lambda s: s.with_law(ff.OrthotropicCoulomb((0.1, 0.2), (1, 0, 0))), "in 2D"),
    ("orthotropic number", lambda s: ff.OrthotropicCoulomb(0.3, (1, 0, 0)), "mu = 0.3 must be a seq"),
    ("orthotropic three", lambda s: ff.OrthotropicCoulomb((0.1, 0.2, 0.3), (1, 0, 0)), "it has 3"),
    ("orthotropic zero", lambda s: ff.OrthotropicCoulomb((0.1, 0), (1, 0, 0)), "> 0"),
    ("orthotropic ratio", lambda s: ff.OrthotropicCoulomb((0.3, 1e-17), (1, 0, 0)), r"mu = \(0.3, 1e-17\) differ by"),
    ("orthotropic axis", lambda s: ff.OrthotropicCoulomb((0.1, 0.2), "x"), "axis .* = 'x'"),
    ("orthotropic axis 2D", lambda s: ff.OrthotropicCoulomb((0.1, 0.2), (1, 0)), "it has 2"),
    ("orthotropic axis 0", lambda s: ff.OrthotropicCoulomb((0.1, 0.2), (0, 0, 0)), "no direction"),
    # surfaces
    ("mesh None", lambda s: ff.ContactSurface(None, s.tags, 1), "mesh = None is None"),
    ("tags None", lambda s: ff.ContactSurface(s.mesh, None, 1), "facet_tags = None is None; give"),
    ("tags array", lambda s: ff.ContactSurface(s.mesh, np.array([1, 2]), 1), "facet_tags = array"),
    ("tags of another mesh", lambda s: s.surface(tags=s.other_tags), "tags are those of another mesh"),
    ("tag None", lambda s: s.surface(None), "tag = None must be an integer"),
    ("tag string", lambda s: s.surface("x"), "tag = 'x' must be an integer"),
    ("tag 1.5", lambda s: s.surface(1.5), "tag = 1.5 must be an integer"),
    ("tag bool", lambda s: s.surface(True), "tag = True must be an integer"),
    ("tag list", lambda s: s.surface([1, 2]), r"tag = \[1, 2\] must be an integer"),
    ("tag absent", lambda s: s.surface(9), "tag 9 marks no facet; tags present"),
    ("name number", lambda s: s.surface(name=3), "name of a contact surface = 3 must be a string"),
    ("name empty", lambda s: s.surface(name=""), "name of a contact surface = '' must be"),
    ("interval", w.interval, "cells of kind interval; contact needs"),
    ("prisms", w.prisms, "cells of kind prism; contact needs"),
    ("single precision", w.single_precision, "coordinates of type float32; make it with"),
    ("shell", w.shell, "dimension 2 in a space of dimension 3"),
    # obstacles
    ("obstacle None", lambda s: s.with_obstacle(None), "obstacle = None is None; give RigidPlane"),
    ("obstacle class", lambda s: s.with_obstacle(ff.RigidPlane), "the class RigidPlane itself"),
    ("obstacle surface", lambda s: s.with_obstacle(s.surface(2)), "obstacle = .* ContactSurface; give"),
    ("obstacle function", lambda s: s.with_obstacle(lambda X: X[1]), "obstacle = .* of type function"),
    ("normal string", lambda s: ff.RigidPlane(POINT, "up"), "normal = 'up' must be a sequence"),
    ("normal None", lambda s: ff.RigidPlane(POINT, None), "normal = None must be a sequence"),
    ("normal scalar", lambda s: ff.RigidPlane(POINT, 1.0), "normal = 1.0 must be a sequence"),
    ("normal zero", lambda s: ff.RigidPlane(POINT, (0, 0)), r"normal \(0, 0\) has no direction"),
    ("normal of one", lambda s: ff.RigidPlane(POINT, (1,)), r"normal = \(1,\) must be .*; it has 1"),
    ("normal of four", lambda s: ff.RigidPlane((0,) * 4, (1,) * 4), "normal = .*; it has 4"),
    ("normal strings", lambda s: ff.RigidPlane(POINT, ("0", "1")), "normal = .* sequence of 2 or 3"),
    ("normal ragged", lambda s: ff.RigidPlane(POINT, [[0, 1], 1]), "normal = .* sequence of 2 or 3"),
    ("normal in 3D", lambda s: s.with_obstacle(ff.RigidPlane((0, 0, 0), (0, 0, 1))), "2 components"),
    ("point nan", lambda s: ff.RigidPlane((NAN, 0), NORMAL), "point = .*nan.* finite"),
    ("point None", lambda s: ff.RigidPlane(None, NORMAL), "point = None must be a sequence"),
    ("point complex", lambda s: ff.RigidPlane((0j, 0), NORMAL), "point = .* must be a sequence"),
    ("center number", lambda s: ff.RigidSphere(0.0, 1.0), "center = 0.0 must be a sequence"),
    ("radius string", lambda s: ff.RigidSphere(POINT, "1"), "radius = '1' must be a number"),
    ("radius None", lambda s: ff.RigidSphere(POINT, None), "radius = None must be a number"),
    ("radius negative", lambda s: ff.RigidSphere(POINT, -1.0), "radius = -1.0 must be > 0"),
    ("radius nan", lambda s: ff.RigidSphere(POINT, NAN), "radius = nan must be > 0"),
    ("radius bool", lambda s: ff.RigidSphere(POINT, True), "radius = True must be a number"),
    ("inside string", lambda s: ff.RigidSphere(POINT, 1.0, "yes"), "inside.* = 'yes' must be True"),
    ("cylinder axis", lambda s: ff.RigidCylinder((0, 0, 0), "z", 1.0), "axis = 'z' must be"),
    ("cylinder axis 0", lambda s: ff.RigidCylinder((0, 0, 0), (0, 0, 0), 1.0), "no direction"),
    ("cylinder in 2D", lambda s: ff.RigidCylinder(POINT, NORMAL, 1.0), "3 finite numbers; it has 2"),
    ("motion string", lambda s: ff.RigidPlane(POINT, NORMAL, motion="x"), "motion = 'x' is of type"),
    ("motion class", lambda s: ff.RigidSphere(POINT, 1.0, motion=ff.RigidMotion), "the class RigidMotion"),
    ("motion of another mesh", lambda s: s.with_obstacle(ff.RigidPlane(POINT, NORMAL, motion=ff.RigidMotion(s.other))), "another mesh than that of u"),
    ("motion mesh None", lambda s: ff.RigidMotion(None), "mesh of a RigidMotion = None"),
    ("motion center", lambda s: w.moved(s, center=0.0), "center of rotation = 0.0 must be"),
    ("motion center 3D", lambda s: w.moved(s, center=(0, 0, 0)), "2 finite numbers; it has 3"),
    ("motion axis string", lambda s: w.moved(s, axis="z"), "axis of rotation = 'z' must be"),
    ("motion axis zero", lambda s: w.moved(s, axis=(0, 0, 0)), "axis of rotation .* no direction"),
    ("distance number", lambda s: s.with_gap(0.0), "distance = 0.0 is of type float; give a function"),
    ("distance UFL", lambda s: s.with_gap(ufl.SpatialCoordinate(s.mesh)[1]), "give a function of the point"),
    ("distance constant", lambda s: s.with_gap(lambda X: 1.0), "does not depend on the point X"),
    ("distance of x", lambda s: s.with_gap(lambda X: ufl.SpatialCoordinate(s.mesh)[1]), "does not depend"),
    ("distance vector", lambda s: s.with_gap(lambda X: X), r"distance.X. returned .* shape \(2,\)"),
    ("distance None", lambda s: s.with_gap(lambda X: None), "distance.X. returned None"),
    ("distance of two", lambda s: s.with_gap(lambda X, Y: X[1]), "distance.X. raised TypeError"),
    ("distance X[2]", lambda s: s.with_gap(lambda X: X[2]), "distance.X. raised"),
    ("distance NumPy", lambda s: s.with_gap(lambda X: np.sin(X[0])), "distance.X. raised TypeError"),
    ("distance of another mesh", lambda s: s.with_gap(lambda X: X[1] - s.scalar(s.other)), "another mesh"),
    ("distance no gradient", lambda s: s.with_gap(lambda X: X[1] ** 2), "has no normal at node"),
    ("shape None", lambda s: s.with_obstacle(w.NoGap()), "gap of the NoGap .* returned None"),
    ("sphere around a node", w.sphere_around_a_node, r"RigidSphere .* no normal at node"),
    ("primary None", lambda s: w.pair(s, None), "primary = None must be a ContactSurface"),
    ("primary string", lambda s: w.pair(s, "top"), "primary = 'top' must be a ContactSurface"),
    ("primary = secondary", lambda s: w.pair(s, s.surface()), "2 facets in common"),
    ("primary of another mesh", w.other_body, "lies on another mesh than the secondary"),
    ("search a dict", lambda s: w.pair(s, s.surface(2), {"reach": 1.0}), "search = .* must be a SearchPolicy"),
    # contacts
    ("surface None", lambda s: s.contact(surface=None), "surface = None is None; give a ContactS"),
    ("surface tags", lambda s: s.contact(surface=s.tags), "surface = .* MeshTags; give a ContactS"),
    ("r_p string", lambda s: s.contact(r_p="1"), "r_p .Pa/m. = '1' must be a number"),
    ("r_p inf", lambda s: s.contact(r_p=INF), "r_p .Pa/m. = inf must be > 0"),
    ("r_p array", lambda s: s.contact(r_p=np.ones(3)), "r_p .Pa/m. = array.* must be a number"),
    # the problem
    ("F None", lambda s: s.problem(F=None), "F = None is None; give a residual"),
    ("F number", lambda s: s.problem(F=0), "F = 0 is of type int; give a residual"),
    ("F list of None", lambda s: s.problem(F=[None], u=[s.u]), r"F\[0\] = None is None"),
    ("F expression", lambda s: s.problem(F=s.density[0]), "F = .* give a residual in UFL"),
    ("F compiled", lambda s: s.problem(F=fem.form(s.F)), "F = .* type Form; give a residual"),
    ("F energy", lambda s: s.problem(F=s.energy), "this one has 0 arguments"),
    ("F bilinear", lambda s: s.problem(F=ufl.derivative(s.F, s.u)), "this one has 2 arguments"),
    ("F square", lambda s: s.problem(F=s.F + s.v[0] ** 2 * ufl.dx), "not linear in its test function"),
    ("F affine", lambda s: s.problem(F=s.F + s.u[0] * ufl.dx), "not linear in its test function"),
    ("F of another u", lambda s: s.problem(u=fem.Function(s.V)), "F does not contain the displ"),
    ("F of another mesh", lambda s: s.problem(F=s.F + s.scalar(s.other) * s.v[0] * ufl.dx(s.mesh)), "another mesh"),
    ("F without values", lambda s: s.problem(F=s.F + ufl.Constant(s.mesh) * s.v[0] * ufl.dx), "no value"),
    ("E of another mesh", w.elastic_of_another_mesh, "F contains the Function .* of another mesh"),
    ("load of no tag", lambda s: s.with_load(s.v[1] * w.ds(s)(7)), r"ds\(7\), which has no boundary"),
    ("load without tags", lambda s: s.with_load(s.v[1] * ufl.ds(1)), r"ds\(1\) without subdomain_data"),
    ("load of other tags", lambda s: s.with_load(s.v[1] * w.ds(s, s.other_tags)(2)), "another mesh"),
    ("two tags of a number", w.two_tags_of_one_number, r"ids \[2\] for different facets"),
    ("u None", lambda s: s.problem(u=None), "u = None is None; give a dolfinx.fem.Function"),
    ("u space", lambda s: s.problem(u=s.V), "u = .* FunctionSpace; give a dolfinx"),
    ("u list of None", lambda s: s.problem(u=[None], F=[s.F]), r"u\[0\] = None is None"),
    ("u twice", lambda s: s.problem(u=[s.u, s.u], F=[s.F, s.F]), "An unknown is given twice"),
    ("u empty", lambda s: s.problem(u=[], F=[]), "0 residuals F for 0 unknowns"),
    ("u component", w.part_of_a_space, "part of another space"),
    ("u complex", w.complex_function, "values of type complex128; make it with"),
    ("contact None", lambda s: s.problem(contact=None), "contact = None is None; give a Contact"),
    ("contact list of None", lambda s: s.problem(contact=[None]), r"contact\[0\] = None is None"),
    ("contact surface", lambda s: s.problem(contact=s.surface()), "contact = .* ContactSurface; give"),
    ("contact twice", w.same_contact, "A Contact is given twice"),
    ("bcs number", lambda s: s.problem(bcs=0), "bcs = 0 is of type int; give a condition"),
    ("bcs list of numbers", lambda s: s.problem(bcs=[0.0]), r"bcs\[0\] = 0.0 is of type float"),
    ("bcs dofs", lambda s: s.problem(bcs=np.arange(3)), "bcs = array.* give a condition"),
    ("bcs of an equal space", w.equal_space, r"bcs\[0\] is on a space that is none of the unknowns'"),
    ("bcs of a collapsed part", w.collapsed_space, r"bcs\[0\] is on a space that is none of"),
    ("bcs without dofs", w.empty_condition, r"bcs\[1\] has no dofs on any rank"),
    ("prefix empty", lambda s: s.problem(petsc_options_prefix=""), "prefix = '' must be a string"),
    ("prefix None", lambda s: s.problem(petsc_options_prefix=None), "prefix = None must be a string"),
    ("prefix spaces", lambda s: s.problem(petsc_options_prefix="a b_"), "prefix = 'a b_' must be"),
    ("prefix dash", lambda s: s.problem(petsc_options_prefix="-a_"), "prefix = '-a_' must be"),
    ("prefix digit", lambda s: s.problem(petsc_options_prefix="1_"), "prefix = '1_' must be"),
    ("options list", lambda s: s.problem(petsc_options=["lu"]), "petsc_options = .* give a dict"),
    ("options string", lambda s: s.problem(petsc_options="-pc_type lu"), "petsc_options = .* give a dict"),
    ("options numbers", lambda s: s.problem(petsc_options={1: 2}), "the key 1; keys are names"),
    ("options dash", lambda s: s.problem(petsc_options={"-pc_type": "lu"}), "the key '-pc_type'"),
    ("maps string", lambda s: s.problem(entity_maps="all"), "entity_maps = 'all' is of type str"),
    ("maps dict", lambda s: s.problem(entity_maps={s.mesh: [0]}), "entity_maps = .* of type dict"),
    ("maps numbers", lambda s: s.problem(entity_maps=[0]), r"entity_maps\[0\] = 0 is of type int"),
    ("settings dict", lambda s: s.problem(settings={"tolerance": 1e-6}), "settings = .* dict; give Step"),
    ("settings class", lambda s: s.problem(settings=settings), "the class StepSettings itself"),
    # settings
    ("tolerance string", lambda s: settings(tolerance="1e-9"), "tolerance = '1e-9' must be a number"),
    ("tolerance nan", lambda s: settings(tolerance=NAN), "tolerance = nan must be > 0 and < 1"),
    ("tolerance None", lambda s: settings(tolerance=None), "tolerance = None must be a number"),
    ("smoothing nan", lambda s: settings(smoothing=NAN), "smoothing = nan must be >= 0"),
    ("smoothing inf", lambda s: settings(smoothing=INF), "smoothing = inf must be >= 0"),
    ("iterations 1.5", lambda s: settings(predictor_iterations=1.5), "predictor_iterations = 1.5 must be an"),
    ("iterations bool", lambda s: settings(predictor_iterations=True), "predictor_iterations = True"),
    ("fallbacks nan", lambda s: settings(fallbacks=NAN), "fallbacks .* = nan must be an integer"),
    ("fallbacks negative", lambda s: settings(fallbacks=-1), "fallbacks .* = -1 must be >= 0"),
    ("ramp_sign bool", lambda s: settings(ramp_sign=True), "ramp_sign = True must be one of"),
    ("corrector list", lambda s: settings(corrector=["ramp"]), r"corrector = \['ramp'\] must be one"),
    ("raise string", lambda s: settings(raise_on_uncertified="no"), "uncertified = 'no' must be True"),
    # bulk
    ("E None", lambda s: ff.bulk.Elastic(None, 0.3), "E = None must be a number"),
    ("E string", lambda s: ff.bulk.Elastic("210e9", 0.3), "E = '210e9' must be a number"),
    ("E array", lambda s: ff.bulk.Elastic(np.ones(3), 0.3), "E = array.* must be a number"),
    ("E vector", lambda s: ff.bulk.Elastic(s.vector, 0.3), "E must be scalar"),
    ("E zero field", lambda s: ff.bulk.Elastic(s.scalar(value=0.0), 0.3), "E = 0.0 must be > 0"),
    ("nu None", lambda s: ff.bulk.Elastic(1.0, None), "nu = None must be a number"),
    ("nu string", lambda s: ff.bulk.Elastic(1.0, "0.3"), "nu = '0.3' must be a number"),
    ("nu array", lambda s: ff.bulk.Elastic(1.0, np.array([0.3])), "nu = array.* must be a number"),
    ("nu field", lambda s: ff.bulk.Elastic(1.0, s.scalar()), "nu = .* must be a number"),
    ("nu 0.5", lambda s: ff.bulk.Elastic(1.0, 0.5), "nu = 0.5 must lie in .-1, 0.5."),
    ("material tuple", lambda s: ff.bulk.neo_hooke_energy(s.u, (1.0, 0.3)), "material = .* give bulk.El"),
    ("u scalar", lambda s: ff.bulk.small_strain_energy(s.scalar(), ff.bulk.Elastic(1.0, 0.3)), r"shape \(\)"),
    ("u array", lambda s: ff.bulk.small_strain_energy(s.u.x.array, ff.bulk.Elastic(1.0, 0.3)), "u = array"),
    ("density one", lambda s: ff.bulk.stored_energy(s.density[0], ufl.dx), "must be the two densities"),
    ("density numbers", lambda s: ff.bulk.stored_energy((1.0, 2.0), ufl.dx), "must be a UFL scalar"),
    ("dx None", lambda s: ff.bulk.stored_energy(s.density, None), "dx = None is None; give a measure"),
    ("degree string", lambda s: w.stress(s, "2"), "degree = '2' must be an integer"),
    ("degree negative", lambda s: w.stress(s, -1), "degree = -1 must be >= 0"),
    ("degree too small", lambda s: w.quadrilateral_energy(1), "degree = 1 is too small"),
    ("bbar of rings", lambda s: ff.bulk.stored_energy(s.density, ufl.dx, bbar=True, axisymmetric=True), "Take a mixed"),
    ("bbar string", lambda s: ff.bulk.stored_energy(s.density, ufl.dx, bbar="no"), "bbar = 'no'"),
    # what is made of a problem
    ("audit problem", lambda s: ff.EnergyAudit(None, s.energy), "problem = None is None; give a Frict"),
    ("audit number", lambda s: w.audit(s, 0.0), "stored = 0.0 is of type float"),
    ("audit residual", lambda s: w.audit(s, s.F), "stored is a form with 1 test functions"),
    ("audit loads", lambda s: w.audit(s, s.energy, s.energy), "loads is a form with 0 test functions"),
    ("fields problem", lambda s: ff.ContactFields(s.u), "problem = .* give a Frict"),
    ("fields contact", lambda s: ff.ContactFields(s.problem(), s.contact()), "none of the problem's contacts"),
    ("fields index", lambda s: ff.ContactFields(s.problem(), 0), "contact = 0 is none of"),
    ("reference problem", w.reference, "problem = None is None; give a Frict"),
    ("Jacobian problem", lambda s: ff.check_jacobian(None), "problem = None is None; give a Frict"),
    ("Jacobian seed", lambda s: ff.check_jacobian(s.problem(), seed=-1), "seed = -1 must be >= 0"),
    ("Jacobian step", lambda s: ff.check_jacobian(s.problem(), step=0.0), "step = 0.0 must be > 0"),
    ("Jacobian amplitude", lambda s: ff.check_jacobian(s.problem(), amplitude=NAN), "amplitude .* = nan"),
]
ELEMENTS = [
    (("Lagrange", 1),), (("Lagrange", 1, (3,)),), (("Lagrange", 1, (2, 2)),),
    (("DG", 0, (2,)),), (("DG", 1, (2,)),),
    (("CR", 1, (2,)),), (("RT", 1),), (("BDM", 1),), (("N1curl", 1),), (("N2curl", 1),),
]
# fmt: on


@pytest.fixture(scope="module")
def setting():
    return w.Setting()


@pytest.mark.parametrize(("build", "match"), [row[1:] for row in ROWS], ids=[r[0] for r in ROWS])
def test_wrong_input_is_refused(setting, build, match):
    with pytest.raises(ff.ContactInputError, match=match):
        build(setting)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: "-".join(map(str, e[0])))
def test_wrong_elements_are_refused(setting, element):
    with pytest.raises(
        ff.ContactInputError, match=r"What works are vectors of continuous Lagrange"
    ):
        setting.with_space(*element)


def test_the_setting_itself_is_right(setting):
    """Else every row might be refused for its sake."""
    problem = setting.problem(bcs=setting.top())  # one condition without a list
    assert problem.solve().certificate.certified
    setting.u.x.array[:] = 0.0
