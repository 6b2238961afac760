"""Is there a simpler filter? The classic filters, each tuned to the lag or noise reduction of yours.

The steady Kalman filter of this model is exponential smoothing with α = K, no more and no less; what it adds is
the start-up, the gaps, and that K follows from two variances. The comparison says so, with numbers.
`agreement` does the same for the estimators of q and r.
"""
