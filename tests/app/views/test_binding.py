from __future__ import annotations

from kalscope_app.views.binding import put


class Handle:
    def __init__(self):
        object.__setattr__(self, "written", [])
        self.label, self.visible = "a", True
        self.written.clear()

    def __setattr__(self, name, value):
        self.written.append(name)
        object.__setattr__(self, name, value)


def test_only_what_differs_is_written():
    handle = Handle()
    put(handle, label="a", visible=False)
    put(handle, label="b", visible=False)
    assert handle.written == ["visible", "label"]
    assert (handle.label, handle.visible) == ("b", False)
