"""The Tune tab: parameters, search, presets, pinned settings."""
