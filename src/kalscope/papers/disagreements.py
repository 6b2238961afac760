"""Where a source document contradicts itself, and what is done here. Facts, told in our words."""

from __future__ import annotations

from dataclasses import dataclass

NOISE_REDUCER = "Ma'arif et al. 2019"
GENERALIZED = "Khan et al."
LIS302DL = "interactive matter 2009"


@dataclass(frozen=True)
class Disagreement:
    """Two statements of one document that cannot both hold."""

    document: str
    """Which document, in short."""
    where: str
    """Equations, figures, sections."""
    one: str
    """The one statement."""
    other: str
    """The other."""
    here: str
    """What Kalscope does."""


DISAGREEMENTS = (
    Disagreement(
        NOISE_REDUCER,
        "Captions of figures 3–8, section 3.1, Table 1",
        "The captions count the results from figure 3 (R = 1, Q = 10) as the first.",
        "The text counts figure 4 as the first examination, and Table 1 leaves figure 3 out.",
        "All six are drawn; Table 1 has the five printed rows, figures 4–8.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Figure 10",
        "Its caption: R = 100, Q = 0.1.",
        "The text of section 3.2: R = 10, Q = 0.01.",
        "Both are drawn. The ratio is 1000 either way, so they differ only until the start is forgotten.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Equations (7) and (12)",
        "The left side is printed as P(t−1), the variance before the prediction.",
        "Equations (2), (9) and (14) need P(t|t−1), the predicted variance, and the appendices compute it.",
        "P(t|t−1), as in the appendices.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Section 2.3 and appendix a",
        "The variance may start at one; the Arduino program does.",
        "The MATLAB program starts it at zero.",
        "Figures 3–8 and Table 1 start at 0, figures 9–10 at 1; rows 3 and 4 of the table fit neither.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Equation (16)",
        "Called the mean error, a distance to the real values.",
        "The formula has no mean, and its two symbols are the raw sample and the filter's output.",
        "Mean of |raw − filtered|, which gives the printed numbers; the RMSE against a known truth stands beside"
        " it.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Section 3.1 and Table 1",
        "A mean error of 40 to 55 marks good parameters.",
        "Row 2 has 44.7392, and the text calls its figure too aggressive for use.",
        "The rule is tested in the paper's chapter.",
    ),
    Disagreement(
        NOISE_REDUCER,
        "Appendix a and Table 1",
        "The program draws (rand − rand)·100, of standard deviation 40.8.",
        "The printed mean errors need a standard deviation of about 72.",
        "Table 1 is simulated with 72, the appendix with its own signal.",
    ),
    Disagreement(
        GENERALIZED,
        "Equation (3)",
        "σE = (1 − K)·E(t−1): the estimate itself enters its error.",
        "The text calls the result the error of the estimate, which needs (1 − K)·σE.",
        'Both are filters here: "printed" and "without_slip".',
    ),
    Disagreement(
        GENERALIZED,
        "Section I and equation (1)",
        "An error is a standard deviation, the two words mean the same.",
        "K = σE/(σE + σM) weighs rightly only if both are variances.",
        "In the reading without the slip they are taken as variances, because then it is a Kalman filter.",
    ),
    Disagreement(
        GENERALIZED,
        "Section II.D and conclusion",
        "The measured error is changed for each sensor.",
        "One algorithm serves all sensors without changing any element.",
        "σM is stated for each figure.",
    ),
    Disagreement(
        GENERALIZED,
        "Discussion of figure 10",
        "The filtered curve leaves the reading as the gain decreases.",
        "It becomes unreliable as the gain increases.",
        "The first holds: the lag is (1 − K)/K samples.",
    ),
    Disagreement(
        LIS302DL,
        "The q pictures and the r pictures",
        "r is then turned down to 1, so it was more than 1 before.",
        "The value of r in the three q pictures is never given.",
        "r = 4 is assumed there; the table shows what 1 and 32 would have made of it.",
    ),
)
"""In the order of the documents."""
