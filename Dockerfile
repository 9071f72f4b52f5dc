# One image for every process of a cluster: the command says which one a container is. See docs/containers.md.
# The libraries in requirements.lock are those for this Python.
ARG PYTHON=3.11
FROM python:${PYTHON}-slim AS build

ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN python -m venv /opt/supernode
ENV PATH=/opt/supernode/bin:$PATH
# The libraries first: a change of this project's own code does not fetch them anew. `make lock` writes the file.
COPY requirements.lock /src/
RUN pip install --require-hashes --only-binary :all: --requirement /src/requirements.lock && touch /src/libraries
COPY . /src/
# Kernels for any processor of this architecture, so that all containers compute the same bits and none compiles.
# The cache knows sources by their times, and layers keep whole seconds only.
ENV NUMBA_CACHE_DIR=/opt/kernels NUMBA_CPU_NAME=generic
RUN pip install --no-deps --no-build-isolation --no-compile /src \
    && find /opt/supernode -name '*.py' -newer /src/libraries \
      -exec touch --date=@946684800 {} + -exec python -m compileall -q {} + \
    && python -m coordinator.launch.compilation

FROM python:${PYTHON}-slim
RUN useradd --system --uid 10001 --create-home supernode \
    && install --directory --owner=supernode --mode=0700 /var/lib/supernode /var/lib/supernode-secret
COPY --from=build /opt/supernode /opt/supernode
# Numba reads a cache only where it could write one.
COPY --from=build --chown=supernode /opt/kernels /opt/kernels
ENV PATH=/opt/supernode/bin:$PATH NUMBA_CACHE_DIR=/opt/kernels NUMBA_CPU_NAME=generic
USER supernode
WORKDIR /home/supernode
VOLUME /var/lib/supernode
STOPSIGNAL SIGTERM
ENTRYPOINT ["supernode"]
CMD ["--help"]
