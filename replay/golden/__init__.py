"""Golden files for trackers: a pytest plugin with the fixture `golden_scene` (see docs/golden.md).

pytest imports the plugin on every start wherever scenetrace is installed, so nothing heavy is
imported before a test asks for the fixture: `GoldenScene` and `GoldenError` are in
`replay.golden.scene`.
"""
