$about%
% Put the samples into z (NaN where one is missing) and run this script: buff_xk is the filtered signal, buff_Kk
% the gain. Without z it filters a random signal. no_plot = true leaves the figure out.

Q = $q;  % process noise q, variance added per sample
R = $r;  % measurement noise r, variance
Pk = $p0;  % start variance p0; Inf: unknown, the first sample sets it
xk = $x0;  % start value; NaN: the first sample
gate = $gate;  % a sample with v^2/s above it is not used, 5 in a row at most; Inf: off
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
