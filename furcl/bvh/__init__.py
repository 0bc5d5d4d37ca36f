"""The tree over fibre segments: built by Embree, turned into blocks on the device."""
