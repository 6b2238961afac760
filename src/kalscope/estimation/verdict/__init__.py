"""What a pair of numbers means: the Estimate of one channel with its intervals, its verdict and its words."""
