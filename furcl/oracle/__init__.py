"""What only checks: rays through Embree, a render on the host, walks over a tree."""
