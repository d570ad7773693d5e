"""For people who write plug-ins: conformance checks, templates to start from, and a pytest plug-in."""
