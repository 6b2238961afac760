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
from kalscope_app.guard.requests import Policy, Refuse

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


def answer_to(policy, hosts=(), origins=(), is_upgrade=False, target="/", cookies=()) -> Refuse | str | None:
    sent = {"Host": hosts, "Origin": origins, "Cookie": cookies, "Upgrade": ("websocket",) * is_upgrade}
    return requests.decide(policy, SimpleNamespace(path=target, headers=SimpleNamespace(get_all=sent.__getitem__)))


def status(answer: Refuse | str | None) -> int:
    return answer.status if isinstance(answer, Refuse) else 200


# --- allowed ----------------------------------------------------------------------------------------------

ALLOWED = {  # beside what `ATTACKS` sends to the real program
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
    "socket by IPv6": socket(hosts=("[::1]:8080",), origins=("http://[::1]:8080",)),
    "socket by the listed name": socket(hosts=("raspberry.local",), origins=("http://raspberry.local",)),
}


@pytest.mark.parametrize("head", ALLOWED.values(), ids=ALLOWED.keys())
def test_the_user_gets_in_and_nobody_without_the_cookie(head):
    assert answer_to(POLICY, **head) is None
    assert status(answer_to(POLICY, **{**head, "cookies": ()})) == 403


# --- refused ----------------------------------------------------------------------------------------------

REFUSED = {  # beside what `ATTACKS` sends to the real program
    "H3 our name as a suffix": (page(hosts=("evil-localhost:8080",)), 403),
    "H3 a listed name as a suffix": (page(hosts=("evil.raspberry.local:8080",)), 403),
    "H3 a listed name with a regex dot": (page(hosts=("raspberryxlocal:8080",)), 403),
    "0.0.0.0 day": (page(hosts=("0.0.0.0:8080",)), 403),
    "a LAN address": (page(hosts=("192.168.1.5:8080",)), 403),
    "a name with user": (page(hosts=("localhost@evil.example:8080",)), 403),
    "a name with a path": (page(hosts=("localhost/evil.example",)), 403),
    "a name with a line end": (page(hosts=("localhost:8080\n",)), 403),
    "an odd port": (page(hosts=("localhost:80a",)), 403),
    "H5 the same Host twice": (page(hosts=(OWN, OWN)), 403),
    "H6 empty Host": (page(hosts=("",)), 403),
    "H7 empty token": (page(target="/?token="), 403),
    "H7 shortened token": (page(target=f"/?token={TOKEN[:-1]}"), 403),
    "H9 websocket= after the token": (page(target=f"/?token={TOKEN}&websocket=ws://evil:1"), 403),
    "H9 websocket= before the token": (page(target=f"/?websocket=ws://evil:1&token={TOKEN}"), 403),
    "H9 percent-encoded": (page(target="/?%77ebsocket=ws://evil:1"), 403),
    "any other query": (page(target="/?x"), 403),
    "token on another path": (page(target=f"/x?token={TOKEN}"), 403),
    "target of bytes": (page(target="/\udcff"), 400),
    "target that is a URL": (page(target="http://127.0.0.1:8080/"), 400),
    "empty target": (page(target=""), 400),
    "wrong cookie": (page(cookies=(COOKIE[:-1],)), 403),
    "longer cookie": (page(cookies=(COOKIE + "x",)), 403),
    "cookie of another port": (page(cookies=(f"kalscope_8081={TOKEN}",)), 403),
    "cookie name in other letters": (page(cookies=(f"Kalscope_8080={TOKEN}",)), 403),
    "page asked by another site": (page(origins=("http://evil.example",)), 403),
    "W5 another local name": (socket(origins=("http://localhost:8080",)), 403),
    "W6 our origin as a user": (socket(origins=(f"http://{OWN}@evil.example",)), 403),
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


def test_anything_that_breaks_the_check_or_viser_itself_is_refused(monkeypatch):
    """CVE-2026-14631: a header that made the check raise took the whole server down."""
    request, served = Request("/x", Headers({"Host": OWN, "Cookie": COOKIE})), requests.RequestFilter(POLICY)
    assert served.answer(lambda *_: 1 / 0, None, request).status_code == 400
    monkeypatch.setattr(requests, "_has_cookie", lambda *_: 1 / 0)
    answer = served.answer(lambda *_: None, None, request)
    assert (answer.status_code, requests.NOT_UNDERSTOOD.reason in answer.body.decode()) == (400, True)


# --- behind a proxy ---------------------------------------------------------------------------------------

BEHIND = dataclasses.replace(POLICY, behind="lab.example:8443")
PROXIED = socket(hosts=("lab.example:8443",), origins=("https://lab.example:8443",))


def test_the_address_of_the_proxy_must_be_https_and_a_name():
    for address in ("https://lab.example", "https://Lab.Example/", "https://lab.example:443"):
        assert requests.behind_of(address) == "lab.example"
    for rest in ("http://x", "x", "https://", "https://x/path", "https://u@x", "https://a b"):
        with pytest.raises(BadSetting, match="--behind must be https://NAME"):
            requests.behind_of(rest)


def test_behind_a_proxy_both_addresses_are_ours_and_the_origin_is_its_address_to_the_letter():
    for head in PROXIED, {**PROXIED, "is_upgrade": False}, SOCKET, PAGE:
        assert answer_to(BEHIND, **head) is None
    odd = "http://lab.example:8443", "https://lab.example", "https://lab.example:8443.evil.example"
    wrong = [{"origins": ()}, {"hosts": ("lab.example",)}, {"hosts": (OWN,)}, {"cookies": ()}]
    wrong += [{"hosts": ("lab.example",), "origins": (), "is_upgrade": False}]
    for changed in (*wrong, *({"origins": (origin,)} for origin in odd)):
        assert status(answer_to(BEHIND, **PROXIED | changed)) == 403
    link = page(target=f"/?token={TOKEN}", cookies=(), hosts=("lab.example:8443",))
    cookie = f"{COOKIE}; HttpOnly; SameSite=Strict; Path={POLICY.home[:-1]}; Secure"
    assert answer_to(BEHIND, **link) == cookie
    assert "wss://lab.example:8443 " in requests.dashboard_csp((), BEHIND.origin_of("lab.example:8443"))


# --- the path of the dashboard ----------------------------------------------------------------------------


def test_only_below_the_path_everything_is_as_viser_knows_it_and_the_path_does_not_tell_the_token():
    home = POLICY.home[:-1]
    for below in ("", "/", "/?token=x", "/a/../b"):
        assert requests.below_home(POLICY, home + below) == (below or "/")
    for foreign in ("/", "/0123/", "x", f"{home}x", f"{home}?x"):
        assert requests.below_home(POLICY, foreign) == foreign
    assert POLICY.home == Policy(9999, TOKEN).home
    assert POLICY.home != Policy(8080, TOKEN + "x").home
    assert re.fullmatch(r"/[0-9a-f]{24}/", POLICY.home)


@pytest.mark.parametrize("cookies", [(), (COOKIE,), ("kalscope_8080=old",)])
def test_the_printed_link_sets_the_cookie(cookies):
    answer = answer_to(POLICY, **page(target=f"/?token={TOKEN}", cookies=cookies))
    assert answer == f"kalscope_8080={TOKEN}; HttpOnly; SameSite=Strict; Path={POLICY.home[:-1]}"


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


@pytest.mark.slow
@given(heads)
def test_no_request_without_the_token_is_allowed(head):
    if TOKEN in head["target"] or any(TOKEN in cookie for cookie in head["cookies"]):
        return  # never happens by chance; it would be the user
    assert isinstance(answer_to(POLICY, **head), Refuse)


@pytest.mark.slow
@given(heads, st.text(string.ascii_lowercase + string.digits + ".-:", max_size=40))
def test_a_foreign_host_or_origin_is_refused_even_with_the_cookie(head, name):
    for hosts in head["hosts"], (name,):
        origins = head["origins"]
        if answer_to(POLICY, **{**head, "hosts": hosts, "cookies": (*head["cookies"], COOKIE)}) is None:
            (host,) = hosts
            assert host.partition(":")[0] in ("localhost", "raspberry.local") or host.startswith("127.")
            assert origins in ((), (f"http://{host}",))
            assert origins or not head["is_upgrade"]


# --- settings, pages, headers -----------------------------------------------------------------------------


def test_a_token_that_a_cookie_cannot_carry_and_a_host_that_is_no_name_are_bad_settings():
    for token in ("", "short", "a" * 129, "with space-16-chars", "semi;colon-16-chars", "ö" * 20):
        with pytest.raises(BadSetting, match="token must have 16 to 128"):
            Policy(8080, token)
    for name in ("", "http://raspberry.local", "*", "a b", "Raspberry.local", "a" * 300):
        with pytest.raises(BadSetting, match="without a port"):
            Policy(8080, TOKEN, frozenset({name}))


def test_our_own_pages_say_what_to_do_escape_and_run_no_script():
    refused = requests.refusal_page(POLICY, Refuse(403, "<script>alert(1)</script>"))
    for words in ("Open the link printed in the terminal", "http://127.0.0.1:8080/?token=", "light dark"):
        assert words in refused
    link = requests.link_page("/over-there/")
    assert '<a href="/over-there/">' in link
    assert "<script" not in refused + link
    assert TOKEN not in refused + link


@pytest.mark.parametrize("csp", [requests.SMALL_PAGE_CSP, requests.dashboard_csp(("'sha256-x'",), f"http://{OWN}")])
def test_headers_forbid_framing_foreign_bases_inline_handlers_and_connecting_elsewhere(csp):
    directives = dict(part.strip().partition(" ")[::2] for part in csp.split(";"))
    assert directives["default-src"] == directives["frame-ancestors"] == directives["base-uri"] == "'none'"
    assert not {"'unsafe-inline'", "'unsafe-eval'"} & set(directives.get("script-src", "").split())
    assert directives.get("connect-src", "") in ("", f"'self' ws://{OWN} data: blob:")
    # The example of W3C CSP 3, section 6.7.3.
    page_of_spec = "<p><script async>alert('Hello, world.');</script></p>"
    assert requests.inline_script_hashes(page_of_spec) == ("'sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng='",)
    expected = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
    assert requests.SECURITY_HEADERS.items() >= expected.items()
