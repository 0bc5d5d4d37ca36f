"""The fibre of Sadeghi et al. 2010."""
