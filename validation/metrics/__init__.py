"""What experiments measure: surface truth, droplet shape, dam-break front; and the shapes they start from."""
