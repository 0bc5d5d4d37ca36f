"""The fibre of Yan et al. 2015: a medulla with an index of its own."""
