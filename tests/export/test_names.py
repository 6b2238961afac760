"""Names from outside never leave a comment or an identifier, in any target."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from dataclasses import replace
from functools import cache

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from tests.support.hostile_names import CODE, LETTERS, TERMINAL, WORDS

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning
from kalscope.export.names import comment_text, identifier, identifiers, number_text
from kalscope.export.registry import TARGETS
from kalscope.export.targets.arduino import UNIT_CHECK

NAMES = (*CODE, *WORDS, *LETTERS, *TERMINAL[4:])
"""What acts on compilers and readers of data."""
SIXES = [NAMES[i : i + 6] for i in range(0, len(NAMES), 6)]
"""The sketch reads at most six channels."""
WRITING = [name for name in TARGETS if name != "one-euro"]  # which needs a recording
WITH_MOMENTUM = [name for name in WRITING if "momentum" not in TARGETS[name].lacks]

CHANNEL = ChannelTuning("calm", "V", 0.01, 0.25, 1.0, 0.5, how="by hand", gate=9.0)


def tuning_of(*names, text="calm", **changes):
    channels = tuple(replace(CHANNEL, name=name, unit=text, how=text, **changes) for name in names)
    return Tuning(channels, source_name=text, sha256=text, sample_period=0.01, tool=text, date=text)


def without_c_comments(text):
    """C, C++ and JavaScript without comments, as their compilers find them: first a backslash (which `??/` is too)
    joins its line to the next, then strings and comments begin at whatever comes first."""
    joined = text.replace("??/", "\\").replace("\\\n", "")
    token = re.compile(r'"[^"\n\\]*(?:\\.[^"\n\\]*)*"|\'[^\'\n]*\'|//[^\n]*|/\*.*?\*/', re.DOTALL)
    return token.sub(lambda m: m[0] if m[0][0] in "\"'" else " ", joined)


def code_of(target, name, text):
    """What a compiler or reader sees of a file: its tokens or values without the comments.

    Whether a sketch checks the unit follows from the unit; the check itself is one text for all.
    """
    text = text.replace(UNIT_CHECK, "")
    if target in ("arduino", "c", "javascript"):
        return without_c_comments(text).split()
    if name.endswith(".py"):
        skip = (tokenize.COMMENT, tokenize.NL)
        tokens = tokenize.tokenize(io.BytesIO(text.encode()).readline)
        return [token.string for token in tokens if token.type not in skip]
    if name.endswith(".m"):
        return [line.split("%")[0].split() for line in text.splitlines() if not line.startswith("%")]
    if name.endswith(".yaml") or target.startswith("home"):
        return yaml.load(text, yaml.CSafeLoader)
    return json.loads(text) if target == "json" else [line.split("#")[0] for line in text.splitlines()]


def without_names(value):
    """Data formats may hold names as values; what must not change is all the rest."""
    if isinstance(value, dict):
        spoken = ("name", "about", "unit", "unit_of_variances", "found", "tool", "date", "recording")
        return {key: without_names(entry) for key, entry in value.items() if key not in spoken}
    return [without_names(entry) for entry in value] if isinstance(value, list) else value


def tunings(target, text):
    """Channels, and sensors of a fusion where the target has it, with a text from outside."""
    channels = tuning_of("a", "b", text=text)
    fusion = ChannelTuning("level", text, 0.01, (1.0, 0.25), sensors=("a", "b"), how=text)
    return [channels] if TARGETS[target].setting else [channels, replace(channels, fusion=fusion)]


def same_code(target, hostile):
    """The export with hostile texts is the export with calm ones, but for comments and strings."""
    for tuning, calm in zip(tunings(target, hostile), calm_code(target), strict=True):
        texts = export_tuning(tuning, target)
        assert list(texts) == list(calm)
        for name, text in texts.items():
            assert text.isascii()
            assert target != "esphome" or re.findall(r"[$]\W.*", text) == []  # it replaces "${…}" inside values
            assert re.search(r"[\x00-\x09\x0b-\x1f\x7f]", text) is None
            assert without_names(code_of(target, name, text)) == calm[name]


@cache
def calm_code(target):
    """The code of each file of the exports without a hostile text."""
    exports = (export_tuning(tuning, target) for tuning in tunings(target, "calm"))
    return [{name: without_names(code_of(target, name, text)) for name, text in files.items()} for files in exports]


@pytest.mark.slow
@pytest.mark.parametrize("target", WRITING)
@given(hostile=st.lists(st.text(max_size=400), min_size=1, max_size=1))
@example(hostile=NAMES)
def test_any_text_stays_in_comments_and_strings(target, hostile):
    for text in hostile:
        same_code(target, text)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "momentum", "options"),
    [
        *((target, 0.0, {}) for target in WRITING),
        *((target, 20.0, {}) for target in WITH_MOMENTUM),
        ("arduino", 0.0, {"calibration": True}),
    ],
)
def test_hostile_channel_names_are_only_identifiers_and_plain_file_names(target, momentum, options):
    """The code with hostile names and texts is the code with the names that they become."""
    for names in SIXES:
        found, calm = (
            export_tuning(tuning_of(*words, text=text, momentum=momentum), target, **options)
            for words, text in ((names, names[0]), (identifiers(names), "calm"))
        )
        assert list(found) == list(calm)
        for file, text in found.items():
            assert re.fullmatch(r"[A-Za-z0-9_]+(\.[a-z]+)?", file), file
            assert text.isascii()
            assert without_names(code_of(target, file, text)) == without_names(code_of(target, file, calm[file]))


@given(names=st.lists(st.text(max_size=50) | st.sampled_from(NAMES), max_size=30))
def test_identifiers_are_distinct_and_fit_every_language(names):
    words = identifiers(names)
    assert len(set(words)) == len(words) == len(names)
    for word in words:
        assert re.fullmatch(r"(?!.*__)[a-z][a-z0-9_]{0,31}(?<!_)", word)
        ast.parse(f"{word} = 1")


def test_identifiers_and_comments_stay_readable_and_identifiers_avoid_words_of_the_languages():
    assert comment_text("50 °C (lab) m/s²" + "y" * 300) == "50 degC (lab) m/s^2".ljust(57, "y") + "..."
    names = ("Température", "accel X (m/s²)", "µA", "for", "9 DOF", "温度")
    assert [*map(identifier, names)] == ["temperature", "accel_x_m_s2", "ua", "ch_for", "ch_9_dof", "channel"]
    assert identifiers(["Temp", "temp", "TEMP", "temp_2"]) == ("temp", "temp_2", "temp_3", "temp_2_2")
    # As a sketch calls the filtered column of another channel.
    assert identifiers(["a", "a filtered"]) == ("a", "a_filtered_2")
    assert identifiers(["a filtered", "a"]) == ("a_filtered", "a_2")


@given(st.floats(allow_nan=False, allow_infinity=False))
@example(1.0)
@example(1e22)
@example(1e-5)
def test_a_number_comes_back_and_is_never_an_integer_or_an_exponent_without_a_point(number):
    text = number_text(number)
    assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", text)
    assert float(text).hex() == number.hex()


@pytest.mark.parametrize("hostile", NAMES)
def test_a_refusal_is_one_line_whatever_the_names_and_those_in_json_are_whole(hostile):
    with pytest.raises(BadSetting, match=r"\A[ -~]+\Z"):
        export_tuning(tuning_of(hostile, text=hostile, r=0.0), "arduino", calibration=True)
    document = json.loads(*export_tuning(tuning_of(hostile, text=hostile), "json").values())
    whole = hostile.encode("utf-8", "replace").decode()
    assert document["channels"][0]["name"] == document["recording"]["name"] == whole
