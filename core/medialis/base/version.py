"""The version of this package."""

from importlib.metadata import PackageNotFoundError, version


def package_version() -> str:
    """Return the installed version; "unknown" when the sources are used without installing."""
    try:
        return version("medialis")
    except PackageNotFoundError:
        return "unknown"
