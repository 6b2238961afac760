"""Several sensors of one quantity: the noise and the offset of each by maximum likelihood."""
