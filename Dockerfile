# furcl on a CPU: docker build -t furcl . && docker run --rm -v "$PWD:/work" furcl furcl render black_hair -o hair.exr
# On an NVIDIA GPU: docker build -t furcl --build-arg BASE=nvidia/cuda:12.6.3-base-ubuntu24.04 .
# and docker run --rm --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,utility -v "$PWD:/work" furcl ...
ARG BASE=debian:bookworm-slim
FROM ${BASE}
# The container's runtime brings the GPU driver's OpenCL, whose name has to be registered.
# hadolint ignore=DL3008
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        ca-certificates python3 python3-venv \
    && rm -rf /var/lib/apt/lists/* \
    && mkdir -p /etc/OpenCL/vendors \
    && echo libnvidia-opencl.so.1 > /etc/OpenCL/vendors/nvidia.icd
COPY . /src
# Intel's runtime for CPUs knows processors that the distributions' PoCL does not.
RUN python3 -m venv /opt/furcl \
    && /opt/furcl/bin/pip install --no-cache-dir /src \
    && /opt/furcl/bin/python -m furcl.install.provision --add intel \
    && rm -rf /src
ENV PATH=/opt/furcl/bin:$PATH
WORKDIR /work
CMD ["furcl", "doctor"]
