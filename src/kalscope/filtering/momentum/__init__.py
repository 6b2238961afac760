"""The filter with momentum: two states, the signal and its velocity, which lasts for a while."""
