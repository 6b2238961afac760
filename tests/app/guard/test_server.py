"""Who may connect, decided without a server. The rows H and W are attacks that stock viser lets through."""

from __future__ import annotations

import dataclasses
import re
import string
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.datastructures import Headers
from websockets.http11 import Request

from kalscope.errors import BadSetting
from kalscope_app.guard import requests
from kalscope_app.guard.messages import upload_refusal
from kalscope_app.guard.requests import (
    NOT_UNDERSTOOD,
    Policy,
    Refuse,
    RequestFilter,
    SetCookie,
    behind_of,
    below_home,
    dashboard_csp,
    dashboard_page,
    decide,
    host_allowed,
    inline_script_hashes,
    link_page,
    page_headers,
    refusal_page,
    small_page_csp,
)
from kalscope_app.guard.server import self_test_attempts

TOKEN = "T0ken-T0ken_T0ken"
POLICY = Policy(8080, TOKEN, frozenset({"raspberry.local"}))
OWN = "127.0.0.1:8080"
COOKIE = f"kalscope_8080={TOKEN}"
PAGE = {"hosts": (OWN,), "cookies": (COOKIE,)}
SOCKET = {**PAGE, "origins": (f"http://{OWN}",), "is_upgrade": True}


def page(**changed) -> dict:
    return {**PAGE, **changed}


def socket(**changed) -> dict:
    return {**SOCKET, **changed}


def answer_to(policy, hosts=(), origins=(), is_upgrade=False, target="/", cookies=()) -> Refuse | SetCookie | None:
    sent = {"Host": hosts, "Origin": origins, "Cookie": cookies, "Upgrade": ("websocket",) * is_upgrade}
    return decide(policy, SimpleNamespace(path=target, headers=SimpleNamespace(get_all=sent.__getitem__)))


def status(answer: Refuse | SetCookie | None) -> int:
    return answer.status if isinstance(answer, Refuse) else 200


# --- allowed ----------------------------------------------------------------------------------------------

ALLOWED = {
    "H8 page with the cookie": PAGE,
    "an asset with the cookie": page(target="/assets/icon.svg"),
    "a bare question mark is no query": page(target="/?"),
    "cookie among others": page(cookies=(f"a=b; {COOKIE}; _xsrf=2|3",)),
    "cookie in a second header": page(cookies=("a=b", COOKIE)),
    "right cookie beside a stale one": page(cookies=(f"kalscope_8080=old; {COOKIE}",)),
    "page asked by our own script": page(origins=(f"http://{OWN}",)),
    "another loopback address": page(hosts=("127.0.1.1:8080",)),
    "IPv6 loopback": page(hosts=("[::1]:8080",)),
    "a tunnel's port": page(hosts=("localhost:9000",)),
    "a name the user listed": page(hosts=("raspberry.local:8080",)),
    "the listed name in capitals": page(hosts=("Raspberry.Local:8080",)),
    "W9 socket by 127.0.0.1": SOCKET,
    "W10 socket by localhost": socket(hosts=("localhost:8080",), origins=("http://localhost:8080",)),
    "socket by IPv6": socket(hosts=("[::1]:8080",), origins=("http://[::1]:8080",)),
    "socket by the listed name": socket(hosts=("raspberry.local",), origins=("http://raspberry.local",)),
}


@pytest.mark.parametrize("head", ALLOWED.values(), ids=ALLOWED.keys())
def test_the_user_gets_in(head):
    assert answer_to(POLICY, **head) is None


@pytest.mark.parametrize("head", ALLOWED.values(), ids=ALLOWED.keys())
def test_the_same_request_without_the_cookie_is_refused(head):
    assert status(answer_to(POLICY, **{**head, "cookies": ()})) == 403


# --- refused ----------------------------------------------------------------------------------------------

REFUSED = {
    "H1 page without cookie": (page(cookies=()), 403),
    "H2 rebinding": (page(hosts=("evil.example:8080",)), 403),
    "H3 our name as a prefix": (page(hosts=("localhost.evil.example:8080",)), 403),
    "H3 our address as a prefix": (page(hosts=("127.0.0.1.nip.io:8080",)), 403),
    "H3 our name as a suffix": (page(hosts=("evil-localhost:8080",)), 403),
    "H3 a listed name as a suffix": (page(hosts=("evil.raspberry.local:8080",)), 403),
    "H3 a listed name with a regex dot": (page(hosts=("raspberryxlocal:8080",)), 403),
    "0.0.0.0 day": (page(hosts=("0.0.0.0:8080",)), 403),
    "a LAN address": (page(hosts=("192.168.1.5:8080",)), 403),
    "a name with user": (page(hosts=("localhost@evil.example:8080",)), 403),
    "a name with a path": (page(hosts=("localhost/evil.example",)), 403),
    "a name with a line end": (page(hosts=("localhost:8080\n",)), 403),
    "an odd port": (page(hosts=("localhost:80a",)), 403),
    "H4 no Host": (page(hosts=()), 403),
    "H5 two Hosts": (page(hosts=(OWN, "evil.example")), 403),
    "H5 the same Host twice": (page(hosts=(OWN, OWN)), 403),
    "H6 unclosed bracket": (page(hosts=("[::1",)), 403),
    "H6 long Host": (page(hosts=("a" * 5000,)), 403),
    "H6 Host of bytes": (page(hosts=("\udcff\udcfe",)), 403),
    "H6 empty Host": (page(hosts=("",)), 403),
    "H7 wrong token": (page(target="/?token=wrong"), 403),
    "H7 empty token": (page(target="/?token="), 403),
    "H7 shortened token": (page(target=f"/?token={TOKEN[:-1]}"), 403),
    "H9 websocket=": (page(target="/?websocket=ws://evil:1"), 403),
    "H9 websocket= after the token": (page(target=f"/?token={TOKEN}&websocket=ws://evil:1"), 403),
    "H9 websocket= before the token": (page(target=f"/?websocket=ws://evil:1&token={TOKEN}"), 403),
    "H9 percent-encoded": (page(target="/?%77ebsocket=ws://evil:1"), 403),
    "H10 playbackPath=": (page(target="/?playbackPath=http://evil/x.viser"), 403),
    "any other query": (page(target="/?x"), 403),
    "token on another path": (page(target=f"/x?token={TOKEN}"), 403),
    "H12 cookie of bytes": (page(cookies=(f"{COOKIE}; x=\udcff",)), 400),
    "target of bytes": (page(target="/\udcff"), 400),
    "target that is a URL": (page(target="http://127.0.0.1:8080/"), 400),
    "empty target": (page(target=""), 400),
    "wrong cookie": (page(cookies=(COOKIE[:-1],)), 403),
    "longer cookie": (page(cookies=(COOKIE + "x",)), 403),
    "cookie of another port": (page(cookies=(f"kalscope_8081={TOKEN}",)), 403),
    "cookie name in other letters": (page(cookies=(f"Kalscope_8080={TOKEN}",)), 403),
    "page asked by another site": (page(origins=("http://evil.example",)), 403),
    "W1 no Origin": (socket(origins=()), 403),
    "W2 evil Origin, no cookie": (socket(origins=("http://evil.example",), cookies=()), 403),
    "W3 evil Origin, stolen cookie": (socket(origins=("http://evil.example",)), 403),
    "W4 null Origin": (socket(origins=("null",)), 403),
    "W5 another local program": (socket(origins=("http://127.0.0.1:3000",)), 403),
    "W5 another local name": (socket(origins=("http://localhost:8080",)), 403),
    "W6 our origin as a prefix": (socket(origins=(f"http://{OWN}.evil.example",)), 403),
    "W6 our origin as a user": (socket(origins=(f"http://{OWN}@evil.example",)), 403),
    "W7 rebinding": (socket(hosts=("evil.example:8080",), origins=("http://evil.example:8080",)), 403),
    "W8 no cookie": (socket(cookies=()), 403),
    "W11 https Origin": (socket(origins=(f"https://{OWN}",)), 403),
    "two Origins, one ours": (socket(origins=(f"http://{OWN}", "http://evil.example")), 403),
    "our Origin twice": (socket(origins=(f"http://{OWN}", f"http://{OWN}")), 403),
    "empty Origin": (socket(origins=("",)), 403),
    "socket with the token in the query": (socket(target=f"/?token={TOKEN}"), 403),
    "socket with a query": (socket(target="/?x=1"), 403),
}


@pytest.mark.parametrize(("head", "expected"), REFUSED.values(), ids=REFUSED.keys())
def test_attack_is_refused(head, expected):
    answer = answer_to(POLICY, **head)
    assert isinstance(answer, Refuse)
    assert answer.status == expected
    assert answer.reason.endswith(".")


def test_anything_that_breaks_the_check_is_refused(monkeypatch):
    """CVE-2026-14631: a header that made the check raise took the whole server down."""
    monkeypatch.setattr(requests, "_has_cookie", lambda *_: 1 / 0)
    request = Request("/", Headers({"Host": OWN, "Cookie": COOKIE}))
    answer = RequestFilter(POLICY).answer(lambda *_: None, None, request)  # pyright: ignore[reportArgumentType]
    assert (answer.status_code, NOT_UNDERSTOOD.status) == (400, 400)
    assert NOT_UNDERSTOOD.reason in answer.body.decode()


# --- behind a proxy ---------------------------------------------------------------------------------------

BEHIND = dataclasses.replace(POLICY, behind="lab.example:8443")
PROXIED = socket(hosts=("lab.example:8443",), origins=("https://lab.example:8443",))


@pytest.mark.parametrize("address", ["https://lab.example", "https://Lab.Example/", "https://lab.example:443"])
def test_the_address_of_the_proxy_is_reduced_to_its_name(address):
    assert behind_of(address) == "lab.example"


@pytest.mark.parametrize(
    "address",
    [
        "http://lab.example",
        "lab.example",
        "https://",
        "https://lab.example/path",
        "https://u@lab.example",
        "https://a b",
    ],
)
def test_the_address_of_the_proxy_must_be_https_and_a_name(address):
    with pytest.raises(BadSetting, match="--behind must be https://NAME"):
        behind_of(address)


@pytest.mark.parametrize("head", [PROXIED, {**PROXIED, "is_upgrade": False}, SOCKET, PAGE])
def test_behind_a_proxy_both_addresses_are_ours(head):
    assert answer_to(BEHIND, **head) is None


@pytest.mark.parametrize(
    "changed",
    [
        {"origins": ("http://lab.example:8443",)},
        {"origins": ("https://lab.example",)},
        {"origins": ("https://lab.example:8443.evil.example",)},
        {"origins": ()},
        {"hosts": ("lab.example",)},
        {"hosts": (OWN,)},
        {"cookies": ()},
    ],
)
def test_behind_a_proxy_the_origin_is_its_address_to_the_letter(changed):
    assert status(answer_to(BEHIND, **{**PROXIED, **changed})) == 403


def test_without_the_option_the_proxy_is_refused():
    assert status(answer_to(POLICY, **PROXIED)) == 403


def test_the_cookie_of_https_is_sent_by_https_only():
    link = page(target=f"/?token={TOKEN}", cookies=(), hosts=("lab.example:8443",))
    assert answer_to(BEHIND, **link) == SetCookie(
        f"kalscope_8080={TOKEN}; HttpOnly; SameSite=Strict; Path={POLICY.home[:-1]}; Secure"
    )
    assert "wss://lab.example:8443 " in dashboard_csp((), BEHIND.origin_of("lab.example:8443"))


# --- the path of the dashboard ----------------------------------------------------------------------------


def test_the_path_follows_from_the_token_and_does_not_tell_it():
    assert POLICY.home == Policy(9999, TOKEN).home
    assert POLICY.home != Policy(8080, TOKEN + "x").home
    assert re.fullmatch(r"/[0-9a-f]{24}/", POLICY.home)


@pytest.mark.parametrize(
    ("asked", "known"),
    [
        ("", "/"),  # the websocket of viser's page
        ("/", "/"),
        ("/?token=x", "/?token=x"),
        ("/a/../b", "/a/../b"),
    ],
)
def test_below_the_path_everything_is_as_viser_knows_it(asked, known):
    assert below_home(POLICY, POLICY.home[:-1] + asked) == known


@pytest.mark.parametrize(
    "target", ["/", "/?token=x", "/0123/", "", "x", POLICY.home[:-1] + "x", POLICY.home[:-1] + "?x"]
)
def test_any_other_path_stays_what_it_is(target):
    assert below_home(POLICY, target) == target


# --- the link ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cookies", [(), (COOKIE,), ("kalscope_8080=old",)])
def test_the_printed_link_sets_the_cookie(cookies):
    answer = answer_to(POLICY, **page(target=f"/?token={TOKEN}", cookies=cookies))
    assert answer == SetCookie(f"kalscope_8080={TOKEN}; HttpOnly; SameSite=Strict; Path={POLICY.home[:-1]}")


def test_the_printed_link_does_not_work_under_a_foreign_name():
    head = page(target=f"/?token={TOKEN}", hosts=("evil.example:8080",))
    assert status(answer_to(POLICY, **head)) == 403


# --- no string opens the door -----------------------------------------------------------------------------

anything = st.text(st.characters(codec=None), max_size=60)
nearly = st.builds(
    lambda start, junk, end: start + junk + end,
    st.sampled_from(["", OWN, "localhost", f"http://{OWN}", "/", "/?token=", "kalscope_8080=", "/?websocket="]),
    anything,
    st.sampled_from(["", OWN, ":8080", ".local", ";", "&token=", f" {TOKEN[:-1]}"]),
)
headers = st.lists(anything | nearly, max_size=3).map(tuple)
heads = st.builds(
    dict,
    hosts=headers | st.just((OWN,)),
    origins=headers | st.just((f"http://{OWN}",)) | st.just(()),
    is_upgrade=st.booleans(),
    target=anything | nearly | st.just("/"),
    cookies=headers,
)


@given(heads)
def test_no_request_without_the_token_is_allowed(head):
    if TOKEN in head["target"] or any(TOKEN in cookie for cookie in head["cookies"]):
        return  # never happens by chance; it would be the user
    assert isinstance(answer_to(POLICY, **head), Refuse)


@given(heads)
def test_a_foreign_host_or_origin_is_refused_even_with_the_cookie(head):
    hosts, origins = head["hosts"], head["origins"]
    if answer_to(POLICY, **{**head, "cookies": (*head["cookies"], COOKIE)}) is None:
        assert len(hosts) == 1
        assert host_allowed(POLICY, hosts[0])
        assert origins in ((), (f"http://{hosts[0]}",))
        assert origins or not head["is_upgrade"]


@given(st.text(string.ascii_lowercase + string.digits + ".-:", max_size=40))
def test_no_name_but_our_own_is_allowed(host):
    name = host.partition(":")[0]
    is_ours = name in {"localhost", "raspberry.local"} or name.startswith("127.")
    assert is_ours or not host_allowed(POLICY, host)


# --- settings, pages, headers -----------------------------------------------------------------------------


@pytest.mark.parametrize("token", ["", "short", "a" * 129, "with space-16-chars", "semi;colon-16-chars", "ö" * 20])
def test_a_token_that_a_cookie_cannot_carry_is_a_bad_setting(token):
    with pytest.raises(BadSetting, match="token must have 16 to 128"):
        Policy(8080, token)


@pytest.mark.parametrize("name", ["", "http://raspberry.local", "*", "a b", "Raspberry.local", "a" * 300])
def test_an_allowed_host_must_be_a_name(name):
    with pytest.raises(BadSetting, match="without a port"):
        Policy(8080, TOKEN, frozenset({name}))


def test_the_refusal_page_says_what_to_do_and_escapes():
    shown = refusal_page(POLICY, Refuse(403, "<script>alert(1)</script>"))
    assert "Open the link printed in the terminal" in shown
    assert "http://127.0.0.1:8080/?token=" in shown
    assert "<script" not in shown
    assert "color-scheme: light dark" in shown
    assert TOKEN not in shown


def test_the_link_page_goes_on_and_only_its_own_script_may_run():
    (own_hash,) = inline_script_hashes(link_page())
    assert '<a href="/over-there/">' in link_page("/over-there/")
    assert own_hash in inline_script_hashes(link_page("/over-there/"))
    assert f"script-src {own_hash};" in small_page_csp()


def test_the_dashboard_page_runs_our_script_before_visers():
    stock = "<html><head><title>Viser</title><script>viser()</script></head><body></body></html>"
    ours = dashboard_page(stock, "first()")
    assert ours.index("first()") < ours.index("viser()")
    assert "<title>Kalscope</title>" in ours
    assert inline_script_hashes(ours)[1:] == inline_script_hashes(stock)
    with pytest.raises(ValueError, match="another head"):
        dashboard_page("<html><title>New</title></html>")


def test_script_hash_is_the_one_of_the_csp_specification():
    """The example of W3C CSP 3, section 6.7.3 (`alert('Hello, world.');`)."""
    page_of_spec = "<p><script async>alert('Hello, world.');</script></p>"
    assert inline_script_hashes(page_of_spec) == ("'sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng='",)


@pytest.mark.parametrize("csp", [small_page_csp(), dashboard_csp(("'sha256-x'",), f"http://{OWN}")])
def test_headers_forbid_framing_foreign_bases_and_inline_handlers(csp):
    headers_of_page = page_headers(csp)
    directives = dict(part.strip().partition(" ")[::2] for part in csp.split(";"))
    assert directives["default-src"] == directives["frame-ancestors"] == directives["base-uri"] == "'none'"
    assert "unsafe-inline" not in directives["script-src"]
    assert "'unsafe-eval'" not in directives["script-src"]
    assert headers_of_page["X-Content-Type-Options"] == "nosniff"
    assert headers_of_page["Referrer-Policy"] == "no-referrer"
    assert headers_of_page["Cache-Control"] == "no-store"
    assert headers_of_page["Cross-Origin-Opener-Policy"] == "same-origin"
    assert headers_of_page["Cross-Origin-Resource-Policy"] == "same-origin"


def test_the_dashboard_may_connect_only_to_itself():
    with_host, without = dashboard_csp(("'sha256-x'",), f"http://{OWN}"), dashboard_csp(("'sha256-x'",))
    assert f"connect-src 'self' ws://{OWN} data: blob:;" in with_host
    assert "connect-src 'self' data: blob:;" in without


def test_the_self_test_expects_what_the_rules_say():
    for attempt in self_test_attempts(POLICY):
        answer = decide(POLICY, Request(below_home(POLICY, attempt.target), Headers(attempt.headers)))
        if attempt.expected_status in (404, 503):  # viser has no such file; sockets wait for the end of the test
            assert answer is None, attempt.what
        else:
            assert status(answer) == attempt.expected_status, attempt.what


# --- uploads ----------------------------------------------------------------------------------------------

MIB = 2**20


@pytest.mark.parametrize(
    ("size", "parts", "words"),
    [
        (0, 0, None),
        (1, 1, None),
        (64 * MIB, 128, None),
        (64 * MIB + 1, 129, "up to 64 MiB"),
        (1, 0, "not be understood"),
        (0, 1, "not be understood"),
        (1, 2, "not be understood"),
        (1, -1, "not be understood"),
        (MIB, 10**9, "not be understood"),
        (-1, 1, "not be understood"),
    ],
)
def test_upload_is_refused_before_it_costs_memory(size, parts, words):
    why = upload_refusal(size, parts, 64 * MIB)
    assert why is None if words is None else why is not None and words in why
