# zpm2 with the weights of its default methods, so that it runs without a network (docs/install.md):
#
#     docker build -t zpm2 .
#     docker run --rm --network none -v "$PWD:/data" zpm2 demo
#
# torch comes from pip's index, which has CUDA builds for x86-64. For a CPU build, or another CUDA, name an index of PyTorch:
#
#     docker build -t zpm2:cpu --build-arg TORCH_INDEX=ADDRESS .

ARG BASE=python:3.12-slim-bookworm

FROM ${BASE} AS build
ARG TORCH_INDEX=
ARG EXTRAS=geo
ARG VERSION=
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN python3 -m venv /opt/zpm2
ENV PATH=/opt/zpm2/bin:$PATH
WORKDIR /build
COPY constraints.txt .
# apart from zpm2, so that a change of its code does not fetch torch again
RUN pip install ${TORCH_INDEX:+--index-url "${TORCH_INDEX}"} "$(grep '^torch==' constraints.txt)"
COPY pyproject.toml README.md LICENSE ./
COPY src src
RUN if [ -n "${VERSION}" ]; then export SETUPTOOLS_SCM_PRETEND_VERSION="${VERSION}"; fi \
    && pip install -c constraints.txt ".[${EXTRAS}]"

FROM ${BASE}
# GDAL, in the wheels of the extra geo, takes it from the system
RUN apt-get update \
    && apt-get install -y --no-install-recommends libexpat1 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 1000 zpm2 \
    && install -d -o zpm2 /data /var/cache/zpm2
COPY --from=build /opt/zpm2 /opt/zpm2
ENV PATH=/opt/zpm2/bin:$PATH ZPM2_CACHE=/var/cache/zpm2
USER zpm2
# fetches and converts the weights, and shows that the image works
RUN zpm2 demo -o /tmp/demo && rm -rf /tmp/demo
WORKDIR /data
ENTRYPOINT ["zpm2"]
CMD ["--help"]
