"""The likelihood of q and r: profile, search and contours."""
