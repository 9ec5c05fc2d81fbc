"""Find, install, launch, pin and supervise game engines.

This layer knows processes and projects on disk; it knows nothing of observations or frames.
"""

from ludus.engine.affinity import (
    CorePlan,
    ReservedCores,
    allowed_cores,
    num_cores,
    pinned_to,
    plan_cores,
    reserve_cores,
)
from ludus.engine.doctor import Finding, FindingStatus, doctor
from ludus.engine.export_game import export_game
from ludus.engine.find import (
    EngineSearch,
    InstalledEngine,
    find_engine,
    list_engines,
    search_engines,
)
from ludus.engine.importing import ensure_imported, needs_import
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
    scene_path,
)
from ludus.engine.screen import find_xvfb, has_screen, with_display
from ludus.engine.template import ExportTemplate, find_template, matching_template

__all__ = [
    "RUN_SCENE",
    "CorePlan",
    "EngineKind",
    "EngineProcess",
    "EngineSearch",
    "ExportTemplate",
    "Finding",
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
    "find_engine",
    "find_project",
    "find_template",
    "find_xvfb",
    "godot_command",
    "has_screen",
    "install_engine",
    "install_screen",
    "install_template",
    "list_engines",
    "matching_template",
    "needs_import",
    "num_cores",
    "pinned_to",
    "plan_cores",
    "read_project",
    "require_addon",
    "reserve_cores",
    "scene_path",
    "search_engines",
    "template_installers",
    "with_display",
]
