"""The Ludus add-on in a user's Godot project."""

from ludus.addon.install import (
    ADDON_PATH,
    GDRL_PATH,
    LEGACY_PATH,
    MANIFEST_NAME,
    PLUGIN,
    AddonChange,
    AddonStatus,
    addon_status,
    install_addon,
    install_folder,
    read_project_file,
    remove_folder,
    write_project_file,
)

__all__ = [
    "ADDON_PATH",
    "GDRL_PATH",
    "LEGACY_PATH",
    "MANIFEST_NAME",
    "PLUGIN",
    "AddonChange",
    "AddonStatus",
    "addon_status",
    "install_addon",
    "install_folder",
    "read_project_file",
    "remove_folder",
    "write_project_file",
]
