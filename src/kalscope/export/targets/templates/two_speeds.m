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
        half = 0.5 * v * v;
        noises = [$spike * R, $spike * R, R, R];
        added = [fast * Q, Q, fast * Q, Q];
        chances = [spikes * moving, spikes * (1 - moving), (1 - spikes) * moving, (1 - spikes) * (1 - moving)];
        first = 1 + 2 * (spikes == 0);  % moving or at rest, each with a spike or a good sample: the widest first
        total = 0; mean_K = 0; squares = 0; left = 0; faster = 0;
        for i = first:4
            certain = 1 / (before + added(i) + noises(i));
            K = (before + added(i)) * certain;
            if i == first
                least = half * certain;
            end
            u = half * certain - least;
            y = u;  % e^-u by arithmetic alone: the same digits in every language
            if u >= 1
                y = u * 0.125;
            end
            even = 1 + y * y * 0.1;
            odd = y * (0.5 + y * y * $odd);
            power = (even - odd) / (even + odd) * (u < $never);
            for j = 1:3 * (u >= 1)
                power = power * power;
            end
            weight = chances(i) * sqrt(certain) * power;
            part = weight * K;
            total = total + weight;
            mean_K = mean_K + part;
            squares = squares + part * K;
            left = left + part * noises(i);
            faster = faster + weight * mod(i, 2);
        end
        whole = 1 / total;
        Kk = mean_K * whole;
        moving = faster * whole;
        Pk = left * whole + max(squares * whole - Kk * Kk, 0) * v * v;
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
