"""Estimation with momentum: likelihood over q, r and τ, the choice of the model, and its words."""
