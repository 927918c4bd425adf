"""Meshes of rigid surfaces: files, scale, defects counted, normals, wrong input."""

import warnings
from pathlib import Path

from mpi4py import MPI

import meshio
import numpy as np
import pytest

import fenicsx_friction as ff
from rectangles import body
from tools import ball, box, uneven_plane

BALL = ball(3, 300, center=(0.0, 0.0, -1.0))
BLOCK = {"low": (-0.5, -0.5, 0.0), "high": (0.5, 0.5, 0.4), "n": [3, 3, 2]}


def volume(tool):
    """Return the volume that the faces enclose, negative if they look inwards."""
    a, b, c = (tool.surface.X[tool.surface.faces[:, i]] for i in range(3))
    return np.sum(np.cross(a, b) * c) / 6.0


@pytest.fixture
def folder(tmp_path_factory):
    """One folder on all ranks."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path_factory.mktemp("tools"))))


def written(path, points, cells):
    if MPI.COMM_WORLD.rank == 0:
        meshio.write(path, meshio.Mesh(points, cells))
    MPI.COMM_WORLD.barrier()
    return path


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("name", ["ball.stl", "ball.ply", "ball.vtk", "ball.msh"])
def test_a_file_in_mm_is_read_back_as_the_tool(folder, name):
    """STL has three points of its own for each triangle: they are merged again."""
    points, faces = BALL
    tool = ff.RigidSurface.from_file(
        written(folder / name, 1e3 * points, [("triangle", faces)]), scale=1e-3
    )
    whole = ff.RigidSurface(points, faces)
    found = tool.soundness
    assert found == whole.soundness and found.parts == 1 and found.faces == 596
    assert len(tool.surface.X) == 300
    assert volume(tool) == pytest.approx(volume(whole), rel=1e-6)
    assert volume(tool) == pytest.approx(4.0 / 3.0 * np.pi, rel=0.03)


@pytest.mark.mpi
def test_a_binary_stl_of_single_precision_far_from_the_origin_is_closed(folder):
    """Written record by record, as programs write it."""
    points, faces = ball(3, 500, center=(40.0, -7.0, 3.0))
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
    rows = np.zeros(len(faces), dtype=record)
    rows["corners"] = points[faces]
    path = folder / "tool.stl"
    if MPI.COMM_WORLD.rank == 0:
        header = b"a tool".ljust(80) + np.uint32(len(faces)).tobytes()
        path.write_bytes(header + rows.tobytes())
    MPI.COMM_WORLD.barrier()
    tool = ff.RigidSurface.from_file(path, open_edges="error")
    assert tool.soundness.faces == 996 and len(tool.surface.X) == 500
    assert tool.surface.X.mean(axis=0) == pytest.approx((40.0, -7.0, 3.0), abs=1e-2)


def test_quadrilaterals_and_segments_of_files(folder):
    points, faces = box((0.0, 0.0, 0.0), (3.0, 2.0, 1.0))
    mixed = [("quad", faces[1:]), ("triangle", [faces[0, :3], faces[0, [0, 2, 3]]])]
    tool = ff.RigidSurface.from_file(written(folder / "box.vtk", points, mixed))
    assert tool.soundness.faces == 12 and tool.soundness.open_edges == 0
    assert volume(tool) == pytest.approx(6.0)
    outline, sides = box((0.0, 0.0), (2.0, 1.0))
    flat = written(folder / "flat.vtk", np.pad(outline, ((0, 0), (0, 1))), [("line", sides)])
    tool = ff.RigidSurface.from_file(flat)
    assert tool.surface.X.shape == (4, 2) and tool.soundness.open_edges == 0
    with pytest.raises(ff.ContactInputError, match=r"no triangle or quad cells.*it has line"):
        ff.RigidSurface.from_file(flat, dimension=3)
    with pytest.raises(ff.ContactInputError, match="not in the plane z = 0"):
        lines = written(folder / "lines.vtk", points, [("line", [[0, 6], [6, 7]])])
        ff.RigidSurface.from_file(lines)


@pytest.mark.mpi
def test_files_that_are_none_are_told_on_all_ranks(folder):
    with pytest.raises(ff.ContactInputError, match="There is no file"):
        ff.RigidSurface.from_file(folder / "none.stl")
    path = folder / "words.stl"
    if MPI.COMM_WORLD.rank == 0:
        path.write_text("these are words")
    MPI.COMM_WORLD.barrier()
    with pytest.raises(ff.ContactInputError, match="meshio cannot read a surface"):
        ff.RigidSurface.from_file(path)
    with pytest.raises(ff.ContactInputError, match="must be a path"):
        ff.RigidSurface.from_file(3)


def test_defects_are_counted():
    points, faces = BALL
    points = np.vstack([points, points[faces[7]].mean(axis=0, keepdims=True)])
    broken = faces.copy()
    broken[[3, 60, 200]] = broken[[3, 60, 200], ::-1]  # no neighbours of each other
    broken = np.vstack([broken, broken[11], [5, 5, 9], [*broken[40, :2], broken[40, 0]]])
    broken = np.delete(broken, 100, axis=0)
    with pytest.raises(ff.ContactInputError, match=r"3 flipped.*orient=True"):
        ff.RigidSurface(points, broken)
    with pytest.warns(UserWarning, match=r"3 open edges.*2 degenerate and 1 double"):
        found = ff.RigidSurface(points, broken, orient=True).soundness
    assert (found.faces, found.degenerate, found.double) == (595, 2, 1)
    assert (found.open_edges, found.branches, found.flipped, found.parts) == (3, 0, 3, 1)
    with pytest.raises(ff.ContactInputError, match=r"3 open edges.*Close it"):
        ff.RigidSurface(points, broken, orient=True, open_edges="error")
    whole = np.delete(faces, 100, axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tool = ff.RigidSurface(points, whole, open_edges="allow")
        turned = ff.RigidSurface(points, np.vstack([whole[:9, ::-1], whole[9:]]), orient=True,
                                 open_edges="allow")  # fmt: skip
    assert np.array_equal(np.sort(tool.surface.faces), np.sort(turned.surface.faces))
    assert volume(turned) == pytest.approx(volume(tool))
    two = [np.vstack([a, b]) for a, b in zip(BALL, (BALL[0] + 5.0, faces + 300), strict=True)]
    assert ff.RigidSurface(*two).soundness.parts == 2
    fin = np.vstack([faces, [*faces[0, :2], 300]])
    with pytest.warns(UserWarning, match="1 edges of more than two faces"):
        ff.RigidSurface(points * 1.1 + 0.0 * points, fin)


def test_segments_are_counted_too():
    angle = np.linspace(0.0, 1.0, 6)
    points = np.column_stack([angle, angle**2])
    sides = np.column_stack([np.arange(5), np.arange(1, 6)])
    sides[2] = sides[2, ::-1]
    with pytest.raises(ff.ContactInputError, match=r"2 open edges.*1 flipped"):
        ff.RigidSurface(points, sides)
    found = ff.RigidSurface(points, sides, orient=True, open_edges="allow").surface
    assert np.array_equal(found.faces[np.argsort(found.faces[:, 0])][:, 0], np.arange(5))


def on(tool, name, **options):
    """Return a block on a tool."""

    def make(msh, surfaces):
        return [ff.Contact(surfaces[1], tool, ff.Coulomb(0.3))]

    return body(make, name, **{**BLOCK, **options})


@pytest.mark.mpi
@pytest.mark.parametrize("shape", ["ball", "floor"])
def test_normals_that_point_away_from_the_body_are_told(shape):
    points, faces = BALL if shape == "ball" else uneven_plane(3)
    on(ff.RigidSurface(points, faces, open_edges="allow"), f"right_{shape}_")
    with pytest.raises(ff.ContactInputError, match="flip=True for a RigidSurface"):
        on(ff.RigidSurface(points, faces, open_edges="allow", flip=True), f"wrong_{shape}_")
    on(ff.RigidSurface(points, faces[:, ::-1], open_edges="allow", flip=True), f"twice_{shape}_")


@pytest.mark.mpi
def test_a_body_that_starts_deep_in_a_tool_is_told():
    deep = ff.RigidSurface(
        *box((-3.0, -3.0, -3.0), (3.0, 3.0, 0.2)), search=ff.SearchPolicy(reach=0.1)
    )
    with pytest.warns(UserWarning, match="16 nodes start deeper behind a face"):
        on(deep, "deep_")


@pytest.mark.mpi
def test_gaps_of_facets_can_be_closed_at_the_start():
    """A block in a bore whose facets it overlaps: with close_gaps nothing is pressed."""
    tools = [
        ff.RigidSurface(*ball(3, 300, center=(0.0, 0.0, -1.01)), close_gaps=c) for c in (None, 0.5)
    ]
    for tool, name in zip(tools, ("open", "closed"), strict=True):
        model = on(tool, f"{name}_")
        gaps = model.contact.pairing.gaps()[model.contact.pairing.meeting()]
        largest = MPI.COMM_WORLD.allreduce(float(np.max(abs(gaps), initial=0.0)), MPI.MAX)
        assert (largest < 1e-15) == (name == "closed")
    with pytest.raises(ff.ContactInputError, match=r"close_gaps = 9 m is more than"):
        on(ff.RigidSurface(*BALL, close_gaps=9.0), "far_")


def test_a_tool_in_the_plane_meets_no_body_in_space():
    with pytest.raises(ff.ContactInputError, match="A RigidSurface cannot be met by points of 3"):
        on(ff.RigidSurface(*uneven_plane(2), open_edges="allow"), "flat_")


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.zeros(3), [[0, 1, 2]]), {}, "points of a RigidSurface.*must be a table"),
        ((np.zeros((3, 4)), [[0, 1, 2]]), {}, "points, 2 or 3"),
        ((np.full((3, 3), np.nan), [[0, 1, 2]]), {}, "not finite"),
        ((np.eye(3), [[0.0, 1.0, 2.0]]), {}, "must be integers"),
        ((np.eye(3), [[0, 1]]), {}, r"\(faces, 3 or 4\)"),
        ((np.eye(3), [[0, 1, 3]]), {}, "from 0 to 2"),
        ((np.eye(3), [[0, 1, -1]]), {}, "from 0 to 2"),
        ((np.eye(3), [[0, 1, 1]]), {}, "no face with an area.*1 degenerate"),
        (BALL, {"scale": 0.0}, "The scale of a RigidSurface = 0"),
        (BALL, {"flip": "yes"}, "flip"),
        (BALL, {"orient": 1}, "orient"),
        (BALL, {"open_edges": "no"}, "open_edges of a RigidSurface = 'no'"),
        (BALL, {"search": 0.1}, "search of a RigidSurface"),
        (BALL, {"close_gaps": -1.0}, "close_gaps"),
        (BALL, {"motion": "up"}, "obstacle's motion"),
    ],
)
def test_wrong_input_is_refused(arguments, options, message):
    with pytest.raises(ff.ContactInputError, match=f"(?s){message}"):
        ff.RigidSurface(*arguments, **options)
