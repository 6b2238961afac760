$about%
% Put the readings into z, a row a sample and a column a sensor (NaN where one has no reading), and run this script:
% buff_xk is the fused value, buff_Kk the gains. Without z it fuses random readings. no_plot = true omits the figure.

Q = $q;  % process noise q, variance added per sample
R = [$r];  % measurement noise of each sensor on the scale of xk, variance / gain squared
b = [$offset];  % what each sensor reads where xk is 0
c = [$gain];  % by how much its reading grows with xk
Pk = $p0;  % start variance p0; Inf: unknown, the first reading sets it
xk = $x0;  % start value; NaN: the first reading
gate = $gate;  % a reading with v^2/s above it is not used, 5 in a row of a sensor at most; Inf: off
refused = zeros(size(R));
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
    z = b + c .* (rand(100, numel(R)) - rand(100, numel(R))) * 100;
end
buff_xk = NaN(size(z, 1), 1);
buff_Kk = zeros(size(z));

for kk = 1:size(z, 1)
@plain     Pk = Pk + Q;
@momentum     Pk = Pk + f * (2 * Gk + f * Wk) + Q11;
@momentum     Gk = e * (Gk + f * Wk) + Q12;
@momentum     Wk = e * e * Wk + Q22;
@momentum     xk = xk + f * vk;
@momentum     vk = e * vk;
    for ii = 1:numel(R)
        zk = (double(z(kk, ii)) - b(ii)) / c(ii);  % integers would round what follows
        s = Pk + R(ii);
        Kk = 0;
        if ~isfinite(zk) || (s == 0 && ~isnan(xk))
            % no reading, or both claim to be exact: keep the value
        elseif isinf(Pk)
            xk = zk; Pk = R(ii); Kk = 1; refused(ii) = 0;
@momentum             Gk = 0;
        elseif (zk - xk) * (zk - xk) > gate * s && refused(ii) < 5
            refused(ii) = refused(ii) + 1;
        else
            if s > 0
                Kk = Pk / s;
            end
@momentum             Lk = 0;
@momentum             if s > 0
@momentum                 Lk = Gk / s;
@momentum             end
            if isnan(xk)
                xk = zk;
            else
@momentum                 vk = vk + Lk * (zk - xk);
                xk = xk + Kk * (zk - xk);
            end
            Pk = Kk * R(ii);
@momentum             Wk = Wk - Lk * Gk;
@momentum             Gk = Lk * R(ii);
            refused(ii) = 0;
        end
        buff_Kk(kk, ii) = Kk;
    end
    buff_xk(kk) = xk;
end

if ~exist('no_plot', 'var') || ~no_plot
    figure(1)
    plot((double(z) - b) ./ c, 'g')
    hold on
    plot(buff_xk, 'r', 'linewidth', 2)
    hold off
    title(sprintf('Readings of %d sensors, offset and gain taken out, and their fusion', numel(R)))
    xlabel('sample')
    ylabel('value')
end
