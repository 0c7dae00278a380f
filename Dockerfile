# gppcs with compiled kernels: a first run starts at once, on every processor of its kind.
#   docker build -t gppcs .
#   docker run --rm -v "$PWD:/data" gppcs simplify scan.laz -o small.laz --ratio 5%
FROM python:3.13-slim AS build
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --yes --no-install-recommends make
COPY . /source
WORKDIR /source
RUN make dist PYTHON=python

FROM python:3.13-slim
COPY --from=build /source/dist/*.whl /wheel/
RUN pip install --no-cache-dir "$(echo /wheel/*.whl)[arrow,e57,picture]" && rm -r /wheel
RUN useradd --create-home --uid 1000 gppcs
USER 1000
WORKDIR /data
ENTRYPOINT ["gppcs"]
