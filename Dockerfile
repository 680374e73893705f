# CPU only. No file of the image need be writable; compiled functions are cached in /tmp:
#   docker build -t mottrack .
#   docker run --rm --read-only --tmpfs /tmp --user "$(id -u):$(id -g)" -v "$PWD/out:/work/out" mottrack demo --quick
# The versions of constraints.txt were tested together on Python 3.11.
FROM python:3.11-slim AS build
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.11-slim
COPY constraints.txt /tmp/
# the index of PyPI gives torch with CUDA's libraries, several GB
RUN pip install --no-cache-dir -c /tmp/constraints.txt \
      --index-url https://download.pytorch.org/whl/cpu torch==2.13.0
RUN --mount=type=bind,from=build,source=/wheel,target=/wheel \
    pip install --no-cache-dir -c /tmp/constraints.txt /wheel/*.whl \
    && useradd --create-home mottrack \
    && install -d -o mottrack -g mottrack /work
USER mottrack
WORKDIR /work
ENTRYPOINT ["mottrack"]
CMD ["--help"]
