$about%
% Put the samples into z (NaN where one is missing) and run this script: buff_xk is the filtered signal, buff_Kk
% the gain. Without z it filters a random signal. no_plot = true omits the figure.

Q = $q;  % process noise q, variance added per sample
R = $r;  % measurement noise r, variance
Pk = $p0;  % start variance p0; Inf: unknown, the first sample sets it
xk = $x0;  % start value; NaN: the first sample
fast = $fast;  % two speeds: Q is this many times larger while the signal moves
spikes = $spikes;  % probability that a sample is a spike, of $spike R
moving = $share;  % probability that the signal moves
if ~exist('z', 'var')
    z = (rand(1, 100) - rand(1, 100)) * 100;
end
buff_xk = NaN(size(z));
buff_Kk = zeros(size(z));

for kk = 1:numel(z)
    zk = double(z(kk));  % integers would round what follows
    before = Pk;
    Kk = 0;
    moving = $share + $lasting * (moving - $share);
    Pk = before + Q + moving * (fast * Q - Q);
    S = Pk + R * (1 + spikes * ($spike - 1));
    if ~isfinite(zk)
        % missing sample: predict only
    elseif isinf(before)
        xk = zk; Pk = R; Kk = 1;
    elseif isnan(xk)
        xk = zk; Kk = Pk / S; Pk = Pk / S * R;
    else
        v = zk - xk;
        square = v * v;
        % hypotheses: a spike, moving, at rest; the exponent of each is at least that of the first two
        noises = [$spike * R, R, R];
        predicted = [Pk, before + fast * Q, before + Q];
        certain = 1 ./ (predicted + noises);
        certain(1) = certain(1) * (spikes > 0);
        wide = predicted(2) + R;
        u = 0.5 * square * certain;
        u = u - min(u(1 + (spikes == 0):2));
        even = 1 + u .* u * $even;  % e^-u by arithmetic alone: the same digits in every language
        odd = u * 0.03125;
        power = (even - odd) ./ (even + odd);
        for i = 1:4
            power = power .* power;
        end
        chances = [spikes, (1 - spikes) * moving, (1 - spikes) * (1 - moving)];
        roots = [sqrt(certain(1) * wide), 1, sqrt(certain(3) * wide)];
        weights = chances .* roots .* (power .* (u < $never));
        weights = weights * (1 / (weights(1) + weights(2) + weights(3)));
        gains = predicted .* certain;
        a = weights .* gains;
        Kk = a(1) + a(2) + a(3);
        spread = max(a(1) * gains(1) + a(2) * gains(2) + a(3) * gains(3) - Kk * Kk, 0);
        moving = weights(2) + weights(1) * moving;
        Pk = ($spike * a(1) + a(2) + a(3)) * R + spread * square;
        xk = xk + Kk * v;
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
