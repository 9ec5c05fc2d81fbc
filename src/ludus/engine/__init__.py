"""Find, install, launch, pin and supervise game engines.

This layer knows processes and projects on disk; it knows nothing of observations or frames.
"""

from ludus.engine.affinity import (
    CorePlan,
    ReservedCores,
    allowed_cores,
    num_cores,
    pinned_to,
    reserve_cores,
)
from ludus.engine.doctor import FindingStatus, doctor
from ludus.engine.export_game import export_game
from ludus.engine.exported import exported_version, is_bevy_game
from ludus.engine.find import (
    InstalledEngine,
    find_engine,
    list_engines,
)
from ludus.engine.importing import ensure_imported
from ludus.engine.install import (
    install_engine,
    install_screen,
    install_template,
    template_installers,
)
from ludus.engine.kinds import EngineKind
from ludus.engine.launch import (
    GodotFlags,
    LaunchConfig,
    executable_command,
    godot_command,
)
from ludus.engine.process import EngineProcess
from ludus.engine.project import (
    RUN_SCENE,
    Project,
    find_project,
    read_project,
    require_addon,
)
from ludus.engine.screen import has_screen, with_display
from ludus.engine.template import ExportTemplate, matching_template

__all__ = [
    "RUN_SCENE",
    "CorePlan",
    "EngineKind",
    "EngineProcess",
    "ExportTemplate",
    "FindingStatus",
    "GodotFlags",
    "InstalledEngine",
    "LaunchConfig",
    "Project",
    "ReservedCores",
    "allowed_cores",
    "doctor",
    "ensure_imported",
    "executable_command",
    "export_game",
    "exported_version",
    "find_engine",
    "find_project",
    "godot_command",
    "has_screen",
    "install_engine",
    "install_screen",
    "install_template",
    "is_bevy_game",
    "list_engines",
    "matching_template",
    "num_cores",
    "pinned_to",
    "read_project",
    "require_addon",
    "reserve_cores",
    "template_installers",
    "with_display",
]
