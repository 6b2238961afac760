"""The dashboard of Kalscope: the only package that knows viser."""
