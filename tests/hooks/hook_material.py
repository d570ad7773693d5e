"""Plug-in packages that are broken in one way each, as pip would have installed them."""

from __future__ import annotations

from pathlib import Path


def install(site: Path, package: str, code: str, requires: str = "geoprior") -> Path:
    """A package, version 1.2, of one module in a folder that can stand in PYTHONPATH."""
    module = package.replace("-", "_")
    (site / f"{module}.py").write_text(code)
    metadata = site / f"{module}-1.2.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\nRequires-Dist: {requires}\n"
    )
    (metadata / "entry_points.txt").write_text(f"[geoprior]\n{module} = {module}\n")
    return site
