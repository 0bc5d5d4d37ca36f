"""Finding out why there is no OpenCL device, and installing a CPU runtime."""
