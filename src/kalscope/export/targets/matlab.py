"""MATLAB and Octave: one script a channel in the style of the appendix of Ma'arif et al. (2019)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.export.header_text import about, about_channel, commented
from kalscope.export.names import number_text

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob
    from kalscope.tuning.tuning import ChannelTuning

_SCRIPT = """\
{about}%
% Put the samples into z (NaN where one is missing) and run this script: buff_xk is the filtered signal, buff_Kk
% the gain. Without z it filters a random signal. no_plot = true leaves the figure out.

Q = {q};  % process noise q, variance added per sample
R = {r};  % measurement noise r, variance
Pk = {p0};  % start variance p0; Inf: unknown, the first sample sets it
xk = {x0};  % start value; NaN: the first sample
gate = {gate};  % a sample with v^2/s above it is not used, 5 in a row at most; Inf: off
refused = 0;

if ~exist('z', 'var')
    z = (rand(1, 100) - rand(1, 100)) * 100;
end
buff_xk = NaN(size(z));
buff_Kk = zeros(size(z));

for kk = 1:numel(z)
    zk = double(z(kk));  % integers would round what follows
    Kk = 0;
    Pk = Pk + Q;
    if isnan(zk)
        % missing sample: predict only
    elseif isinf(Pk)
        xk = zk; Pk = R; Kk = 1; refused = 0;
    elseif (zk - xk) * (zk - xk) > gate * (Pk + R) && refused < 5
        refused = refused + 1;
    else
        Kk = Pk / (Pk + R);
        if isnan(xk)
            xk = zk;
        else
            xk = xk + Kk * (zk - xk);
        end
        Pk = (1 - Kk) * Pk;
        refused = 0;
    end
    buff_xk(kk) = xk;
    buff_Kk(kk) = Kk;
end

if ~exist('no_plot', 'var') || ~no_plot
    figure(1)
    plot(z(:), 'g', 'linewidth', 2)
    hold on
    plot(buff_xk(:), 'r', 'linewidth', 2)
    hold off
    title(sprintf('Signal and Kalman filter with R = %g, Q = %g', R, Q))
    xlabel('sample')
    ylabel('value')
    legend('raw signal', 'filtered signal')
end
"""


def files(job: ExportJob) -> dict[str, str]:
    """`kalman_IDENTIFIER.m`, one a channel: the workspace of a script has one filter."""
    return {
        f"kalman_{word}.m": _script(job, channel)
        for word, channel in zip(job.identifiers, job.channels, strict=True)
    }


def _script(job: ExportJob, channel: ChannelTuning) -> str:
    return _SCRIPT.format(
        about=commented((*about(job), *about_channel(job, channel)), "%"),
        q=number_text(channel.q),
        r=number_text(channel.r),
        p0="Inf" if channel.p0 is None else number_text(channel.p0),
        x0="NaN" if channel.x0 is None else number_text(channel.x0),
        gate="Inf" if channel.gate is None else number_text(channel.gate),
    )
