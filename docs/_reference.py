"""Reference pages that are made from the code whenever the site is built.

Commands come from their own ``--help``, GDScript classes from Godot's ``--doctool`` and error
messages from the lines that raise them, so that none can differ from the code.
"""

from __future__ import annotations

import ast
import contextlib
import inspect
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import ludus.errors
from ludus.cli.main import COMMANDS, main
from ludus.engine import EngineKind, find_engine

ADDON = Path(__file__).parents[1] / "engines" / "godot4"
SOURCE = Path(ludus.errors.__file__).parent

# GDScript has no access modifiers: these members are public because the add-on's own scripts share
# them. Games have no use for them.
ADDON_INTERNALS = {
    "LudusActionComponent": "is_valid to_json describe",
    "LudusAgent": "FORMER_SAMPLE_ACTIONS observer connect_to_game game_observes known_entries "
    "has_mask is_in_batch doubts is_leaving has_truncation has_manual_action path_in_world",
    "LudusCamera2D": "connect_viewport aim_viewport",
    "LudusCamera3D": "connect_viewport aim_viewport",
    "LudusDebugView": "take_decision take_person",
    "LudusObservationEntry": "infer num_bytes to_bytes floats to_json describe",
    "LudusPolicy": "incompatibility",
    "LudusPolicyPlayer": "advance",
    "LudusPolicySettings": "to_json",
    "LudusSensor2D": "make_entry",
    "LudusSensor3D": "make_entry",
    "LudusSimulation": "overrides describe",
    "LudusSimulationHost": "FORMER_SAMPLE_ACTIONS is_settling place set_running is_sharing",
    "LudusTraining": "FORMER_NAMES is_in_charge to_json",
    "LudusWorld": "num_placed is_ready find_in attach take_over set_seed "
    "distance_between_copies begin_episode",
}


def write_command_pages(folder: Path) -> None:
    """Write one page for each command, with its help and that of its subcommands."""
    _make_empty(folder)
    for name, (_, summary) in COMMANDS.items():
        text = _help(name)
        page = [f"# ludus {name}", "", f"{summary.capitalize()}.", "", *_literal(text)]
        for subcommand in _subcommands(text):
            page += ["", f"## ludus {name} {subcommand}", "", *_literal(_help(name, subcommand))]
        (folder / f"{name}.md").write_text("\n".join(page) + "\n", encoding="utf-8")


def write_gdscript_pages(folder: Path) -> None:
    """Write one page for each global class of the Godot 4 add-on that a game of today uses.

    Raises:
        EngineNotFound: There is no Godot 4.
    """
    _make_empty(folder)
    with tempfile.TemporaryDirectory(prefix="ludus-docs-") as temporary:
        project, xml, pages = (Path(temporary) / name for name in ("project", "xml", "pages"))
        shutil.copytree(ADDON / "addons", project / "addons")
        (project / "project.godot").write_text("config_version=5\n")
        xml.mkdir()
        godot = [str(find_engine(EngineKind.GODOT4).path), "--headless", "--path", str(project)]
        # Without an import Godot knows no global class, and documents none.
        _run([*godot, "--import"])
        _run([*godot, "--doctool", str(xml), "--no-docbase", "--gdscript-docs", "res://addons"])
        for class_file in xml.glob("Ludus*.xml"):
            _leave_out_internals(class_file)
        _run([str(Path(sys.executable).with_name("c3-godot-docs-gen")), str(xml), str(pages)])
        written = {page.name: page.read_text("utf-8") for page in pages.glob("Ludus*.md")}
    # What plays games written for godot-ai; they use godot-ai's names instead.
    written = {name: text for name, text in written.items() if not name.startswith("LudusClassic")}
    for name, text in written.items():
        (folder / name).write_text(_site_links(text, name, written), encoding="utf-8")


def write_error_pages(folder: Path) -> None:
    """Write one page that lists every message of every error, with its hint."""
    _make_empty(folder)
    page = [
        "# Error messages",
        "",
        "The messages that Ludus raises, by the class of the error. `<name>` stands for what is",
        "inserted, which may be empty, and `…` for what is computed.",
    ]
    messages = _messages()
    for name in ludus.errors.__all__:
        error = getattr(ludus.errors, name)
        if not inspect.isclass(error) or not messages.get(name):
            continue
        summary = inspect.cleandoc(error.__doc__ or "").splitlines()[0]
        page += ["", f"## {name}", "", f"{summary} The command exits with {error.exit_code}.", ""]
        for message, hint in sorted(messages[name].items()):
            page += [f"- {_code(message)}", *([f"  <br>Hint: {_code(hint)}"] if hint else [])]
    (folder / "messages.md").write_text("\n".join(page) + "\n", encoding="utf-8")


def _messages() -> dict[str, dict[str, str]]:
    """Return ``{class: {message: hint}}``, read from the calls in the source."""
    found: dict[str, dict[str, str]] = {}
    modules = [ast.parse(file.read_text("utf-8")) for file in sorted(SOURCE.rglob("*.py"))]
    constants: dict[str, str] = {}
    for module in modules:
        constants |= _constants(module)
    for module in modules:
        # Its own constants come before those of the same name that other modules have.
        _ConstantInserter(constants | _constants(module)).visit(module)
        for node in ast.walk(module):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args:
                named = [keyword.value for keyword in node.keywords if keyword.arg == "hint"]
                message = _template(node.args[0])
                hint = "".join(_template(value) for value in [*node.args[1:2], *named][:1])
                if message.strip("…"):
                    found.setdefault(node.func.id, {})[message] = hint if hint.strip("…") else ""
    return found


def _constants(module: ast.Module) -> dict[str, str]:
    """Return the texts and numbers that a module names in capitals."""
    found: dict[str, str] = {}
    for node in module.body:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                pairs = list(zip(names, values, strict=False))
            case ast.Assign(targets=[target], value=value):
                pairs = [(target, value)]
            case _:
                continue
        for target, value in pairs:
            match target, value:
                case ast.Name(id=name), ast.Constant(value=str() | int() as constant):
                    if name.isupper():
                        found[name] = str(constant)
                case _:
                    pass
    return found


class _ConstantInserter(ast.NodeTransformer):
    """Puts constants into the f-strings that name them."""

    def __init__(self, constants: dict[str, str]) -> None:
        self._constants = constants

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.expr:
        if isinstance(node.value, ast.Name) and node.value.id in self._constants:
            return ast.Constant(self._constants[node.value.id])
        return node


def _template(value: ast.expr) -> str:
    """Return the text that an expression makes, with `<name>` or `…` where it inserts something."""
    match value:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return _join_parts([_template(part) for part in parts])
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _join_parts([_template(left), _template(right)])
        case ast.FormattedValue(value=ast.Name(id=name) | ast.Attribute(attr=name)):
            return f"<{name.strip('_').lower()}>"
    return "…"


def _join_parts(parts: list[str]) -> str:
    """Join parts of a text, with the space that an inserted part brings along beside a word."""
    return re.sub(r"(?<=[\w>])(?=<\w+>)|(?<=\w>)(?=[\w\u2026])", " ", "".join(parts))


def _code(text: str) -> str:
    return "`` " + " ".join(text.split()) + " ``"


def _leave_out_internals(class_file: Path) -> None:
    """Remove the members that games do not use from a class that Godot described.

    Those are the members of `ADDON_INTERNALS`, those without a description (private ones, and
    methods that the base class describes), and those whose type is a script without a name.
    """
    tree = ET.parse(class_file)
    name = tree.getroot().get("name", "")
    internals = set(ADDON_INTERNALS.get(name, "").split())
    unknown = internals - {member.get("name") for member in tree.iterfind("./*/*")}
    if unknown:
        raise ValueError(f"ADDON_INTERNALS: {name} has no {', '.join(sorted(unknown))}")
    for group in tree.getroot():
        for member in list(group):
            if member.get("name") in internals or _is_undocumented(member):
                group.remove(member)
    tree.write(class_file, encoding="utf-8", xml_declaration=True)


def _is_undocumented(member: ET.Element) -> bool:
    if member.get("enum") and member.tag == "constant":
        return False
    description = member.findtext("description") or member.text or ""
    types = [part.get("type", "") for part in member.iter()]
    is_private = member.get("name", "").startswith("_")
    return is_private or not description.strip() or any(".gd" in type_ for type_ in types)


def _site_links(page: str, name: str, pages: dict[str, str]) -> str:
    """Make links of a generated page work in the site.

    MyST does not see anchors written in HTML, so links to them become HTML, too. Links to classes
    that have no page, and to members that are left out, become text.
    """

    def link(found: re.Match[str]) -> str:
        text, file, anchor = found[1], found[2], found[3]
        if file and file not in pages:
            return text
        if not anchor:
            return found[0]
        shown = re.sub(r"`([^`]*)`", r"<code>\1</code>", text)
        if f'<a id="{anchor[1:]}">' not in pages[file or name]:
            return shown
        return f'<a href="{file.replace(".md", ".html")}{anchor}">{shown}</a>'

    page = re.sub(r"\[([^\[\]]*)\]\(([\w.]*)(#[\w-]+)?\)", link, page)
    page = re.sub(
        r'<a href="(\w+\.md)">([^<]*)</a>',
        lambda found: found[0] if found[1] in pages else found[2],
        page,
    )
    return re.sub(r'href="([\w]+)\.md', r'href="\1.html', page)


def _help(*command: str) -> str:
    """Return what ``ludus COMMAND --help`` prints, as in a terminal of 88 columns."""
    output = io.StringIO()
    with _plain_terminal(), contextlib.redirect_stdout(output):
        main([*command, "--help"])
    return output.getvalue().strip()


@contextlib.contextmanager
def _plain_terminal() -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(COLUMNS="88", NO_COLOR="1", TERM="dumb")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _subcommands(help_: str) -> list[str]:
    usage = help_.split("\n\n", maxsplit=1)[0]
    found = re.search(r"\{([a-z,-]+)\}", usage)
    return found[1].split(",") if found else []


def _literal(text: str) -> list[str]:
    return ["```text", text, "```"]


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=120)


def _make_empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
