"""The fibre of Marschner et al. 2003."""
