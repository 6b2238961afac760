"""The classic filters, which run in place of the Kalman filter or before it, and chains of them."""

from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro

__all__ = ["Butterworth", "Chain", "Exponential", "Median", "MovingAverage", "Notch", "OneEuro"]
