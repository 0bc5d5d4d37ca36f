"""The fibre of d'Eon et al. 2011."""
