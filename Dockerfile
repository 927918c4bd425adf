# The one description of the environment: DOLFINx 0.11 with PETSc, as packaged in Debian sid.
# `./container` builds it with Docker, Podman or buildah and keys the image by this file's content.
ARG BASE=debian:sid
FROM ${BASE}

# One thread per MPI rank; ranks may exceed cores and run as root inside a container;
# pictures are drawn off screen by EGL in software, without looking for an X server first.
ENV OMP_NUM_THREADS=1 \
    OMPI_ALLOW_RUN_AS_ROOT=1 \
    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
    PRTE_MCA_mapby=:oversubscribe \
    PYVISTA_OFF_SCREEN=true \
    VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow

# Snapshots of sid can be past their validity date on slow mirrors; the signatures are still checked.
# An image needs neither manuals nor a sync to disk after every package; pip installs into it
# with the tools that are there ("false" is how pip spells that). It ends with a check.
RUN printf '%s\n' 'Acquire::Check-Valid-Until "false";' 'Acquire::Retries "5";' \
      > /etc/apt/apt.conf.d/99-image \
 && printf '%s\n' force-unsafe-io path-exclude='/usr/share/doc/*' path-exclude='/usr/share/man/*' \
      path-exclude='/usr/share/locale/*' path-include='/usr/share/doc/*/copyright' \
      > /etc/dpkg/dpkg.cfg.d/image \
 && printf '%s\n' '[global]' 'break-system-packages = true' 'no-build-isolation = false' \
      'root-user-action = ignore' > /etc/pip.conf \
 && apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
      # forms are compiled just in time
      gcc libc6-dev \
      # finite elements, meshes, fields on disk
      python3-dolfinx python3-gmsh python3-h5py \
      # numerics and pictures; a fast BLAS, or packages are content with the reference one
      libopenblas0-pthread python3-scipy python3-matplotlib python3-pyvista \
      libegl1 libgl1-mesa-dri fonts-dejavu-core \
      # terminal output, tests, checks, packaging
      python3-rich python3-pytest python3-pytest-xdist python3-hypothesis \
      ruff mypy python3-pip python3-setuptools python3-wheel make git openssh-client \
      python3-build twine python3-pytest-cov \
      # the documentation
      python3-sphinx python3-myst-nb python3-ipykernel python3-jupytext python3-sphinx-book-theme \
      python3-sphinx-copybutton python3-sphinx-design python3-sphinxcontrib.bibtex \
 # its formulas without a network: one file of MathJax, not Node.js, which the package asks for
 && cd /tmp && apt-get download node-mathjax-full \
 && dpkg-deb --fsys-tarfile node-mathjax-full_*.deb | tar -x -C / ./usr/share/nodejs/mathjax-full/es5/tex-svg.js \
 && rm node-mathjax-full_*.deb && cd / \
 && apt-get clean && rm -rf /var/lib/apt/lists/* \
 && python3 -c 'import dolfinx.fem.petsc, gmsh, pyvista'
