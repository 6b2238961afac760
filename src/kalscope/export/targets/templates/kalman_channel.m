$about%
% Put the samples into z (NaN where one is missing) and run this script: buff_xk is the filtered signal, buff_Kk
% the gain. Without z it filters a random signal. no_plot = true omits the figure.

Q = $q;  % process noise q, variance added per sample
R = $r;  % measurement noise r, variance
Pk = $p0;  % start variance p0; Inf: unknown, the first sample sets it
xk = $x0;  % start value; NaN: the first sample
gate = $gate;  % a sample with v^2/s above it is not used, 5 in a row at most; Inf: off
refused = 0;
@momentum tau = $momentum;  % momentum in samples: how long the signal keeps its direction; the next six follow from q and tau
@momentum e = $e;  % share of the velocity that is left after a sample
@momentum f = $f;  % how far a velocity of 1 goes in a sample
@momentum Q11 = $q11;  % variance added per sample to xk,
@momentum Q12 = $q12;  % to the covariance Gk of xk and the velocity vk,
@momentum Q22 = $q22;  % and to the velocity
@momentum Wk = $w0;  % variance of the velocity, here at the start
@momentum Gk = 0;
@momentum vk = 0;  % velocity, per sample

if ~exist('z', 'var')
    z = (rand(1, 100) - rand(1, 100)) * 100;
end
buff_xk = NaN(size(z));
buff_Kk = zeros(size(z));

for kk = 1:numel(z)
    zk = double(z(kk));  % integers would round what follows
    Kk = 0;
@plain     Pk = Pk + Q;
@momentum     Pk = Pk + f * (2 * Gk + f * Wk) + Q11;
@momentum     Gk = e * (Gk + f * Wk) + Q12;
@momentum     Wk = e * e * Wk + Q22;
@momentum     xk = xk + f * vk;
@momentum     vk = e * vk;
    if ~isfinite(zk)
        % missing sample: predict only
    elseif isinf(Pk)
        xk = zk; Pk = R; Kk = 1; refused = 0;
@momentum         Gk = 0;
    elseif (zk - xk) * (zk - xk) > gate * (Pk + R) && refused < 5
        refused = refused + 1;
    else
        Kk = Pk / (Pk + R);
@momentum         Lk = Gk / (Pk + R);
        if isnan(xk)
            xk = zk;
        else
@momentum             vk = vk + Lk * (zk - xk);
            xk = xk + Kk * (zk - xk);
        end
        Pk = Kk * R;
@momentum         Wk = Wk - Lk * Gk;
@momentum         Gk = Lk * R;
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
