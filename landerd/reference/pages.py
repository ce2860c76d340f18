"""All files that are made of the code, by their place in a checkout."""

from collections.abc import Mapping

from landerd.reference import ardupilot_files, configuration_page, fault_page, parameter_page


def pages() -> Mapping[str, str]:
    """Return the text of every made file, by its path below the checkout."""
    return {
        "docs/parameters.md": parameter_page.markdown(),
        "docs/configuration-keys.md": configuration_page.markdown(),
        "docs/faults.md": fault_page.markdown(),
        **ardupilot_files.files(),
    }
