"""Pictures, their files, and differences between them."""
