"""The fibre of Chiang et al. 2016."""
