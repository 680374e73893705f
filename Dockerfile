# CPU only. No file of the image need be writable; compiled functions are cached in /tmp:
#   docker build -t mottrack --build-arg TORCH_OPTIONS="--index-url <index of CPU wheels>" .
#   docker run --rm --read-only --tmpfs /tmp --user "$(id -u):$(id -g)" -v "$PWD/out:/home/mottrack/out" mottrack demo --quick
# The versions of constraints.txt were tested together on Python 3.11.
FROM python:3.11-slim AS build
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.11-slim
COPY constraints.txt /tmp/
# options of pip for torch: name PyTorch's index of CPU wheels here, or CUDA's libraries come along, several GB
ARG TORCH_OPTIONS=""
RUN pip install --no-cache-dir -c /tmp/constraints.txt ${TORCH_OPTIONS} torch==2.13.0
RUN --mount=type=bind,from=build,source=/wheel,target=/wheel \
    pip install --no-cache-dir -c /tmp/constraints.txt /wheel/*.whl \
    && useradd --create-home mottrack
USER mottrack
WORKDIR /home/mottrack
ENTRYPOINT ["mottrack"]
CMD ["--help"]
