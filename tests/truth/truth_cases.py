"""What must not change by accident: every case of `tests/truth/*.jsonl`, computed by the public functions.

A case is a line of plain values with an id "group#name".
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from functools import cache, partial
from itertools import product, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from tests.truth.verdict_states import SIGNALS, STATES, row_of

import kalscope as ks
from kalscope.analysis.judge import judge
from kalscope.cli.app import run
from kalscope.estimation.many import Series, estimate_many, series_of
from kalscope.estimation.pool import fit_pool, pool_of
from kalscope.estimation.request import find_parameters
from kalscope.export.registry import TARGETS
from kalscope.filtering.classic import Chain, OneEuro

Case = dict[str, Any]
Groups = dict[str, Callable[[], Iterator[Case]]]
"""What makes the cases, by the group in their ids."""

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
ROOTS = {"sample_data": ROOT / "sample_data", "shared": ROOT.parent / "shared" / "data"}
LONGEST, SHOWN = 300_000, 50
"""Samples of a recording that are used; spikes whose places are stored (of more, the first and a hash of all)."""


# --- plain values ---------------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """In values that JSON can hold, numbers to 12 digits."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.12g}") if math.isfinite(value) else str(value)
    return value


def fields(of: Any, names: str) -> Case:
    return plain({name: getattr(of, name) for name in names.split()})


def bits(array: Any) -> str:
    """A hash of the float64 bits; NaN is one value."""
    values = np.asarray(array, np.float64)
    return hashlib.sha256(np.where(np.isnan(values), np.nan, values).tobytes()).hexdigest()[:16]


def places(spikes: Any) -> list[Any]:
    return plain(spikes[:SHOWN]) + ([len(spikes), bits(spikes)] if len(spikes) > SHOWN else [])


# --- estimates ------------------------------------------------------------------------------------------


def recordings() -> Iterator[str]:
    for name, root in ROOTS.items():
        files = (path for path in sorted(root.rglob("*")) if path.is_file() and path.suffix not in (".md", ".py"))
        yield from (f"{name}/{path.relative_to(root).as_posix()}" for path in files)


def of_recording(place: str) -> Iterator[Case]:
    """The estimates of each channel, as `kalscope tune` finds them and as the plain fit of all samples."""
    root, _, path = place.partition("/")
    try:
        recording = ks.read_recording(ROOTS[root] / path)
    except ks.BadFile:
        return
    dt = recording.steps()[:LONGEST] if recording.gaps == "dt" else None
    for name, column in zip(recording.names, recording.values.T, strict=True):
        z = np.ascontiguousarray(column[:LONGEST])
        case = {"id": f"{place}#{name}", "n": len(z), "period": plain(recording.sample_period)}
        yield case | {"tuned": fitted(z, dt), "plain": fitted(z, dt, momentum=0.0, robust=False)}


def fitted(z: Any, dt: Any, **options: Any) -> Case:
    fit = ks.estimate(z, dt=dt, **options)
    names = "verdict q r ratio loglik q_se r_se ratio_interval resolution message"
    if not options:
        names += " momentum momentum_interval gain_interval lag_interval prediction_gain gate"
        names += " outlier_share plain_q plain_r plain_momentum"
    spikes = {} if fit.outliers is None else {"spikes": places(np.flatnonzero(fit.outliers))}
    return fields(fit, names) | {"usable": fit.params is not None} | spikes


# --- filters --------------------------------------------------------------------------------------------


def record(g: Any, n: int, tau: float, sensors: int = 1) -> tuple[Any, Any]:
    """A quantity that moves, read with noise, misses and spikes, shape (n, sensors); and uneven steps or None."""
    moves = g.normal(size=n)
    for i in range(1, n if tau else 0):
        moves[i] += math.exp(-1.0 / tau) * moves[i - 1]
    noise = 10.0 ** g.uniform(-1.0, 1.0, sensors)
    z = 20.0 + 0.1 * np.cumsum(moves)[:, None] + noise * g.normal(size=(n, sensors))
    z[g.random(z.shape) < g.choice([0.0, 0.01])] += 50.0
    z[g.random(z.shape) < g.choice([0.0, 0.1, 0.6])] = np.nan
    dt = g.choice([0.0, 0.5, 1.0, 1.3, 40.0], n, p=[0.02, 0.3, 0.3, 0.36, 0.02]) if g.random() < 0.4 else None
    return z, dt


def start(g: Any) -> Case:
    """The start, the gate and the momentum of a model: each in some cases only."""
    model: Case = [{}, {}, {"p0": 10.0 ** g.uniform(-6, 6)}, {"p0": 4.0, "x0": 19.0}][int(g.integers(4))]
    gate, tau = [None, 9.0, 16.0][int(g.integers(3))], 10.0 ** g.uniform(-1.0, 2.5)
    return model | {"gate": gate, "momentum": float(tau) if g.random() < 0.5 else 0.0}


def filters(count: int = 120) -> Iterator[Case]:
    for seed in range(count):
        g = np.random.default_rng([1, seed])
        model = {"q": 10.0 ** g.uniform(-6, 2), "r": 10.0 ** g.uniform(-3, 3)} | start(g)
        model |= [{}, {}, {}, {"q": 0.0}, {"r": 0.0}][int(g.integers(5))]
        z, dt = record(g, int(g.choice([1, 2, 9, 40, 333, 2500, 20_000])), model["momentum"])
        z, params = np.ascontiguousarray(z[:, 0]), ks.FilterParams(**model)
        case = {"id": f"filters#{seed:03d}", "n": len(z), "uneven": dt is not None, "model": plain(model)}
        yield case | filtered(z, params, dt)


def filtered(z: Any, params: Any, dt: Any) -> Case:
    one, back = ks.kalman_filter(z, params, dt), ks.smooth(z, params, dt)
    both = ks.kalman_filter(np.column_stack([z, z[::-1]]), params, dt)
    case = fields(one, "loglik m rejected") | states(one, "x p k innovation s velocity velocity_p")
    case["smoothed"] = states(back, "x p velocity")
    case["streams"] = streams(ks.KalmanFilter(params), z, dt, one)
    case["columns"] = bits([both.x[:, 0], both.p[:, 0]]) == bits([one.x, one.p])
    size = np.nanmax(np.abs(z), initial=1.0)
    case["denoises"] = bool(np.allclose(ks.denoise(z, params, dt), one.x, 0.0, 1e-12 * size, equal_nan=True))
    return case


def states(result: Any, names: str) -> Case:
    """Bits of each array, and its values in the middle and at the end, so that a difference can be read."""
    kept = {name: row for name in names.split() if (row := getattr(result, name)) is not None}
    read = {name: [plain(row[len(row) // 2]), plain(row[-1])] for name, row in kept.items()}
    return {"bits": {name: bits(row) for name, row in kept.items()}, "values": read}


def streams(running: Any, z: Any, dt: Any, whole: Any, most: int = 2500) -> bool:
    """Whether the filter gives the same bits sample by sample."""
    x, p = np.empty(min(len(z), most)), np.empty(min(len(z), most))
    for i in range(len(x)):
        x[i], p[i] = running.update(z[i], None if dt is None else dt[i]), running.p
    return bits([x, p]) == bits([whole.x[:most], whole.p[:most]])


# --- fusions --------------------------------------------------------------------------------------------


def fusions(count: int = 24) -> Iterator[Case]:
    for seed in range(count):
        g = np.random.default_rng([2, seed])
        sensors, model = int(g.integers(2, 5)), start(g)
        z, dt = record(g, int(g.choice([150, 400, 900])), model["momentum"], sensors)
        gains = bool(g.random() < 0.4)
        model |= {"offset": g.normal(0, 2, sensors), "gain": g.uniform(0.7, 1.4, sensors) ** gains}
        model |= {"q": 10.0 ** g.uniform(-4, 0), "r": 10.0 ** g.uniform(-2, 2, sensors)}
        z = model["offset"] + model["gain"] * z
        if seed % 4 == 3:
            spoil(g, z, seed // 4)
        options = {"reference": None if seed % 3 else 0, "robust": bool(seed % 4) and "auto"}
        fit = ks.estimate_fusion(z, dt=dt, gains=gains, **options)
        names = "verdict q momentum r offset gain q_interval r_interval offset_interval loglik message notes"
        case = {"id": f"fusions#{seed:02d}", "model": plain(model), "tuned": fields(fit, names)}
        case["tuned"] |= {"gain_interval": plain(fit.sensor_gain_interval)}
        case["tuned"] |= {"spikes": [places(rows) for rows in fit.spikes], "usable": fit.params is not None}
        if fit.params is not None:
            case["judged"] = fields(judged := ks.judge_fusion(z, fit, dt), "error best sentences")
            case["sensors"] = [
                fields(one, "faults share error")
                | {"sentences": [*(fault.text for fault in one.findings), *one.if_it_fails]}
                for one in judged.sensors
            ]
        yield case | fused(z, ks.FilterParams(**model), dt)


def spoil(g: Any, z: Any, fault: int) -> None:
    """What can be wrong with sensors: a copy, stuck, silent, shared noise, no movement, no noise."""
    if fault < 3:
        z[:, -1] = (z[:, 0], 5.0, np.nan)[fault]
    elif fault == 3:
        z[:, :2] += 10.0 * g.normal(size=(len(z), 1))
    else:
        z[:] = 3.0 * g.normal(size=z.shape)
        z[:, 0] *= fault == 4
        z += np.cumsum(g.normal(size=(len(z), 1)), axis=0) * (fault == 5)


def fused(z: Any, params: Any, dt: Any) -> Case:
    one, back = ks.fuse(z, params, dt), ks.smooth(z, params, dt)
    case = fields(one, "loglik m rejected") | states(one, "x p k innovation s velocity velocity_p")
    return case | {"smoothed": states(back, "x p"), "streams": streams(ks.KalmanFilter(params), z, dt, one)}


# --- fleets ---------------------------------------------------------------------------------------------


def fleets() -> Iterator[Case]:
    for name, count in (("even", 40), ("uneven", 40), ("moving", 12)):
        g = np.random.default_rng([3, count, len(name)])
        lengths = np.full(count, 300) if name == "even" else g.integers(20, 700, count)
        pairs = [record(g, n, 8.0 * (name == "moving")) for n in lengths]
        series = [z[:, 0] for z, _ in pairs]
        dt = [np.ones(len(z)) if dt is None else dt for z, dt in pairs] if name == "uneven" else None
        if name == "uneven":
            series[3], series[5], series[7] = np.full(len(series[3]), 2.5), series[5] * np.nan, np.round(series[7])
        many = series_of(series, dt)
        yield from table(name, many)
        pooled = fields(fit_pool(pool_of(many)), "q r ratio loglik ratio_interval verdict")
        yield {"id": f"fleets#{name}, pooled, each", "tuned": pooled}


def table(name: str, many: Series) -> Iterator[Case]:
    """The row of each device."""
    found = estimate_many(many)
    columns = fields(found, "verdict q r spikes gate")
    ends = ("q_interval", "r_interval")
    columns |= {one: plain(np.transpose(getattr(found, one))) for one in ends}
    for i in range(len(many)):
        yield {"id": f"fleets#{name}, {i:02d}", "row": {one: rows[i] for one, rows in columns.items()}}


# --- sentences ------------------------------------------------------------------------------------------

COMMANDS = (
    "nile; flex_sensor --details; ldr_pwm; hot_water; ultrasonic; tank_level --all; lis302dl --all; "
    "nile --lag-ms 1e11; flex_sensor --lag-ms 200; ultrasonic --gain 0.9; nile --sigma 100; nile --ratio 1; "
    "balancing_robot --cutoff-hz 2; flex_finger --momentum 0 --no-robust; tank_level --fuse sonar,float,pressure"
)


def states_judged() -> Iterator[Case]:
    """Filters that were set by hand on known records, the first answer on each of these, and their judgements."""
    judged = {f"by hand, {state.name()}": row_of(state).said for state in STATES}
    for name, z in SIGNALS.items():
        found = find_parameters(z)
        tested = ks.diagnose(ks.kalman_filter(z, found.params), fitted=found.reason == "best_fit")
        judged[f"first answer, {name}"] = judge(tested, None, found.estimate, request=found.request)
    for name, one in judged.items():
        advice = [{"text": each.text, "action": type(each.action).__name__} for each in one.findings]
        case = {"id": f"judged#{name}", "advice": advice}
        yield case | fields(one, "status word tone headline") | {"held_out": one.second_half}


def commands() -> Iterator[Case]:
    """What `kalscope tune` prints, wherever its lines are broken, or why it refuses."""
    for command in COMMANDS.split("; "):
        name, *options = command.split()
        with redirect_stdout(io.TextIOWrapper(io.BytesIO())) as out, redirect_stderr(io.StringIO()) as refused:
            code = run(["tune", f"sample:{name}", *options])
        out.flush()
        text = refused.getvalue() if code else out.buffer.getvalue().decode()
        yield {"id": f"commands#{command}", "text": re.sub("[ \n]+", " ", text).strip()}


def words() -> Iterator[Case]:
    """Every sentence and half sentence in the code of findings; {} stands for a value."""
    found = set[str]()
    for folder in ("estimation", "analysis"):
        for path in sorted((ROOT / "src" / "kalscope" / folder).rglob("*.py")):
            found.update(text for text in literals(ast.parse(path.read_text("utf-8"))) if text.count(" ") >= 3)
    yield from ({"id": f"words#{text}"} for text in sorted(found))


def literals(node: ast.AST) -> Iterator[str]:
    """The texts below a node, without docstrings and errors."""
    if isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
        return
    parts = list(ast.iter_child_nodes(node))
    if isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        parts = [part for part in node.values if not isinstance(part, ast.Constant)]
    for part in parts:
        yield from literals(part)


# --- exports --------------------------------------------------------------------------------------------


def tunings(level: ks.Recording) -> Iterator[tuple[str, Any]]:
    made = {"tool": "kalscope", "date": "2026-01-01T00:00:00Z", "sample_period": 0.05}
    one, names, chain = partial(ks.ChannelTuning, unit="mm"), level.names, Chain(5, OneEuro(0.01, 0.1, 0.1))
    several = (one(names[0], q=0.02, r=1.5, gate=16.0), one(names[1], q=1e-5, r=0.3, p0=2.0, x0=40.0))
    scales = {"offset": (0.0, 1.5, -1.0), "gain": (1.0, 0.9, 1.1)}
    fusion = one("level", q=0.01, r=(1.0, 2.0, 0.5), sensors=names, **scales)
    yield "channels", ks.Tuning(several, **made)
    yield "momentum", ks.Tuning((one(names[0], q=0.001, r=1.5, momentum=12.5),), **made)
    yield "chain", ks.Tuning((one(names[0], q=0.02, r=1.5, chain=chain),), **made)
    yield "fusion", ks.Tuning(several, fusion=fusion, **made)


def exports() -> Iterator[Case]:
    """A hash of each file that each target writes, or its refusal."""
    level = ks.read_recording(ROOTS["sample_data"] / "tank_level.csv")
    options = ({}, {"vectors": level}, {"calibration": True})
    targets = [name for name, each in TARGETS.items() if each.setting is None]
    for (name, tuning), option, target in product(tunings(level), options, targets):
        case = {"id": f"exports#{', '.join([name, target, *option])}"}
        try:
            files = ks.export_tuning(tuning, target, **option)
        except ks.BadSetting as error:
            yield case | {"refused": str(error)}
        else:
            yield case | {file: hashlib.sha256(files[file].encode()).hexdigest()[:16] for file in sorted(files)}


# --- all ------------------------------------------------------------------------------------------------

SETS = ("estimates", "filters", "fusions", "fleets", "sentences", "exports")
GROUPS: dict[str, Groups] = {
    "filters": {"filters": filters},
    "fusions": {"fusions": fusions},
    "fleets": {"fleets": fleets},
    "sentences": {"judged": states_judged, "commands": commands, "words": words},
    "exports": {"exports": exports},
}


def groups_of(name: str) -> Groups:
    return GROUPS.get(name) or {place: partial(of_recording, place) for place in recordings()}


@cache
def stored(name: str) -> dict[str, dict[str, Case]]:
    """The stored cases of a set by their ids, by group."""
    groups: dict[str, dict[str, Case]] = {}
    path = HERE / f"{name}.jsonl"
    for line in path.read_text("utf-8").splitlines() if path.is_file() else ():
        case = json.loads(line)
        groups.setdefault(case["id"].partition("#")[0], {})[case["id"]] = case
    return groups


# --- how a case differs from the stored one -----------------------------------------------------------------

RELATIVE = 1e-6
"""Difference of a number that is accepted."""
SHOWN_RELATIVE = 0.011
"""The same of a number in a sentence, which has three digits: the last may change at the edge of rounding."""
ABSOLUTE = {"prediction_gain": 1e-6}
"""Numbers that are differences of others."""

_NUMBER = re.compile(r"\d[\d\u202f]*(?:\.\d+)?(?:e[+-]?\d+)?")


def changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """What differs between two groups of cases, and which likelihoods became higher."""
    wrong, better = list[str](), list[str]()
    for name in {**old, **new}:
        if name not in new or name not in old:
            wrong.append(f"{name}: {'is gone' if name in old else 'is new'}")
        else:
            wrong += [f"{name}{difference}" for difference in differences(old[name], new[name], better, name)]
    return wrong, better


def differences(
    old: Any, new: Any, better: list[str], name: str, at: str = "", exact: bool = True
) -> Iterator[str]:
    """Each difference of two plain values; where a likelihood is higher, only those of codes and words."""
    if isinstance(old, dict) and isinstance(new, dict):
        logliks = [old.get("loglik"), new.get("loglik")]
        gain = logliks[1] - logliks[0] if all(map(is_number, logliks)) else 0.0
        if at.endswith((".tuned", ".plain")) and gain > 1e-6 + 1e-10 * abs(old["loglik"]):
            better.append(f"{name}{at}: log-likelihood {gain:.3g} higher")
            exact = False
        for key in {**old, **new}:
            yield from differences(old.get(key), new.get(key), better, name, f"{at}.{key}", exact)
    elif isinstance(old, list) and isinstance(new, list):
        for i, (one, other) in enumerate(zip_longest(old, new)):
            yield from differences(one, other, better, name, f"{at}[{i}]", exact)
    elif is_number(old) and is_number(new):
        near = ABSOLUTE.get(at.rpartition(".")[2], 0.0)
        if exact and not math.isclose(old, new, rel_tol=RELATIVE, abs_tol=near):
            yield f"{at}: {old!r} became {new!r}"
    elif old != new and not (isinstance(old, str) and isinstance(new, str) and same_words(old, new, exact)):
        yield f"{at}: {old!r} became {new!r}"


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def same_words(old: str, new: str, exact: bool) -> bool:
    """Whether two sentences are the same, their numbers but for the last digit shown."""
    if " " not in old or _NUMBER.sub("0", old) != _NUMBER.sub("0", new):
        return False
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    values = ([float(text.replace("\u202f", "")) for text in pair] for pair in pairs)
    return not exact or all(math.isclose(*pair, rel_tol=SHOWN_RELATIVE) for pair in values)
