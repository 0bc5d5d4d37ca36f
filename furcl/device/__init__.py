"""OpenCL: devices, programs, memory and what crosses to kernels."""
