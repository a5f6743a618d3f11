"""The library's rooms, files, functions and pages: no include goes up, every stage is complete."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[3]
NATIVE = ROOT / "native"


def table_of_rooms() -> list[tuple[str, set[str]]]:
    """Rooms and their stems, lowest first, as docs/development.md lists them."""
    page = (ROOT / "docs" / "development.md").read_text(encoding="utf-8")
    table = page.partition("### Rooms")[2].partition("\n##")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", table, flags=re.MULTILINE)
    return [(room, set(re.findall(r"`(\w+)`", stems))) for room, stems in rows]


ROOMS = table_of_rooms()
ORDER = [room for room, _ in ROOMS]


def files(folder: str) -> list[Path]:
    return sorted(p for p in (NATIVE / folder).rglob("*") if p.suffix in (".cpp", ".hpp"))


def upward_includes(room: str, text: str) -> list[str]:
    included = re.findall(r'#include "(?:pointmorph/)?(\w+)/(\w+)\.hpp"', text)
    return [f"{to}/{stem}" for to, stem in included if ORDER.index(to) > ORDER.index(room)]


@pytest.mark.parametrize("folder", ["include/pointmorph", "src"])
def test_no_include_goes_up(folder: str) -> None:
    found = files(folder)
    assert found
    upward = {
        str(path.relative_to(NATIVE)): names
        for path in found
        if (names := upward_includes(path.parent.name, path.read_text(encoding="utf-8")))
    }
    assert upward == {}


def test_an_upward_include_would_be_noticed() -> None:
    assert upward_includes("cloud", '#include "pointmorph/morph/morph.hpp"\n') == ["morph/morph"]
    assert upward_includes("morph", '#include "cloud/bucket_tree.hpp"\n') == []


def test_the_table_of_rooms_is_complete() -> None:
    stems: dict[str, set[str]] = {}
    for path in files("include/pointmorph") + files("src"):
        stems.setdefault(path.parent.name, set()).add(path.stem)
    assert stems == dict(ROOMS)


@pytest.mark.parametrize(
    "header", files("include/pointmorph"), ids=lambda p: f"{p.parent.name}/{p.stem}"
)
def test_source_and_test_stand_in_the_header_s_room(header: Path) -> None:
    room, stem = header.parent.name, header.stem
    sources = [NATIVE / "src" / room / f"{stem}.cpp"]
    tests = [NATIVE / "tests" / room / f"test_{stem}.cpp"]
    elsewhere = [p for p in files("src") if p.stem == stem and p not in sources]
    elsewhere += [p for p in files("tests") if p.stem == f"test_{stem}" and p not in tests]
    assert elsewhere == []


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "stages").glob("*/*.md")), ids=lambda p: p.stem
)
def test_a_stage_has_its_header_source_and_test(page: Path) -> None:
    room, stem = page.parent.name, page.stem
    assert (NATIVE / "include" / "pointmorph" / room / f"{stem}.hpp").exists()
    assert (NATIVE / "src" / room / f"{stem}.cpp").exists()
    assert (NATIVE / "tests" / room / f"test_{stem}.cpp").exists()


NO_STAGES = {
    "base/assignment": "a tool of several stages: rows and columns of a table that belong together",
    "base/error": "what all stages throw",
    "base/parallel": "what all stages run their loops on",
    "base/progress": "what all stages report to",
    "base/types": "arrays of all stages",
    "cloud/kd_tree": "what most stages search points with",
    "cloud/oriented_points": "data alone",
    "morph/cut_preview": "what a Morph would do, to look at: the stage is disk/decomposition",
    "morph/live_morph": "a Morph that is bent again: the stage is registration/live_map",
    "morph/loop_suggestion": "what a Morph would do, to look at: the stage is disk/decomposition",
    "morph/morph_input": "data alone",
    "morph/morph_options": "the options of all stages in one struct",
    "morph/network_preview": "what a Morph would do, to look at: the stage is disk/network",
    "morph/options": "the table that docs/options.md is made from",
    "morph/report": "data alone",
    "registration/alternatives": "data alone: what registration/pose leaves over",
    "registration/diagnostics": "data alone: what registration/refinement says of itself",
    "surface/sampled_surface": "data alone",
}
"""Headers without a page, each with the reason."""


def stage_of_part(header: Path) -> str | None:
    """The stage that a header says it is a part of."""
    first = header.read_text(encoding="utf-8").partition("\n")[0]
    part = re.match(r"// A part of stage `(\w+)`", first)
    return part[1] if part else None


@pytest.mark.parametrize(
    "header", files("include/pointmorph"), ids=lambda p: f"{p.parent.name}/{p.stem}"
)
def test_a_stage_has_its_page(header: Path) -> None:
    """So has every other header, but for a reason; parts of a stage are on its page."""
    room, stem = header.parent.name, stage_of_part(header) or header.stem
    has_page = (ROOT / "docs" / "stages" / room / f"{stem}.md").exists()
    assert has_page != (f"{room}/{header.stem}" in NO_STAGES)


def test_every_header_that_is_no_stage_is_there() -> None:
    headers = {f"{p.parent.name}/{p.stem}" for p in files("include/pointmorph")}
    assert set(NO_STAGES) <= headers
    assert all(NO_STAGES.values())


def users_of(pattern: str) -> set[str]:
    """Names of the native sources in which a line that is no comment has `pattern`."""
    everything = [
        p for folder in ("include", "src", "bindings", "benchmarks") for p in files(folder)
    ]
    lines = {p.name: re.sub(r"//[^\n]*", "", p.read_text(encoding="utf-8")) for p in everything}
    return {name for name, text in lines.items() if re.search(pattern, text)}


def test_one_file_knows_openmp() -> None:
    assert users_of(r"omp\.h|\bomp_|#pragma (?!once|GCC unroll)") == {"openmp_engine.cpp"}


def test_one_file_asks_for_the_compiler() -> None:
    words = (
        *("__attribute__", "__restrict", "__builtin", "__declspec", "__extension__", "__int128"),
        *("__GNUC__", "__clang__", "_MSC_VER", "typeof__", r"\basm\b", r"\[\[gnu::"),
    )
    assert users_of("|".join(words)) == {"compiler.hpp"}


# --- Size of functions

LONGEST_FUNCTION = 80
MOST_PARAMETERS = 6
# Longer functions, each with the reason.
LONG_FUNCTIONS: dict[str, str] = {}


class Function(NamedTuple):
    name: str
    lines: int
    parameters: int


def without_comments(text: str) -> str:
    """The same lines, without comments, preprocessor lines and what strings hold."""
    pattern = r'//[^\n]*|/\*.*?\*/|R"\((?:.|\n)*?\)"|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])\''

    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n") if match[0].startswith("/") else '""'

    text = re.sub(pattern, blank, text, flags=re.DOTALL)
    return re.sub(r"^[ \t]*#[^\n]*", "", text, flags=re.MULTILINE)


def parameters_of(signature: str) -> int:
    """How many parameters stand between the first parentheses."""
    depth, count, anything = 0, 1, False
    start = signature.index("(")
    for i in range(start, len(signature)):
        c = signature[i]
        depth += c in "(<{["
        depth -= c in ")>}]" and signature[i - 1] != "-"
        if depth == 0:
            break
        count += c == "," and depth == 1
        anything = anything or (i > start and not c.isspace())
    return count if anything else 0


def functions_in(text: str) -> list[Function]:
    """Functions that are defined or declared in namespaces and classes."""
    text = without_comments(text)
    found: list[Function] = []
    # Of each open brace what stands before it, and its line; None for namespaces and classes.
    stack: list[tuple[str, int] | None] = []
    start = 0
    for i, c in enumerate(text):
        inside = any(kind is not None for kind in stack)
        if c == "{":
            head = text[start:i].strip()
            scope = re.search(
                r"^(template\s*<.*>\s*)?(namespace|struct|class|enum|extern)\b", head, re.DOTALL
            )
            is_function = not inside and "(" in head and not scope
            stack.append(
                None
                if not inside and not is_function
                else (head, text.count("\n", 0, i) - head.count("\n"))
            )
            if not inside:
                start = i + 1
        elif c == "}":
            kind = stack.pop() if stack else None
            inside = any(other is not None for other in stack)
            if kind is not None and not inside and "(" in kind[0]:
                head, first = kind
                name = re.findall(r"([\w:~]+|operator\S+)\s*\(", head)
                lines = text.count("\n", 0, i) - first + 1
                found.append(Function(name[0] if name else head, lines, parameters_of(head)))
            if not inside:
                start = i + 1
        elif c == ";" and not inside:
            head = text[start:i].strip()
            declared = re.match(r"[^=]*?([\w:~]+)\s*\(", head, re.DOTALL)
            if declared and not head.startswith(("using", "static_assert")):
                parameters = parameters_of(head[declared.end(1) :])
                found.append(Function(declared[1], head.count("\n") + 1, parameters))
            start = i + 1
    return found


def test_the_size_of_functions_is_measured() -> None:
    short = "namespace p {\nint f(int a, pair<int, int> b) {\n    if (a) {\n    }\n}\n"
    assert functions_in(short) == [Function("f", 4, 2)]
    method = "struct S {\n    S(int a, int b = g(1, 2));\n    void h() const { go({1, 2}); }\n};\n"
    assert functions_in(method) == [Function("S", 1, 2), Function("h", 1, 0)]
    long = "void f() {\n" + "    g();\n" * 90 + "}\n"
    assert functions_in(long) == [Function("f", 92, 0)]


def test_no_function_is_long() -> None:
    long = {
        f"{path.relative_to(NATIVE)} {function.name}": function.lines
        for folder in ("include", "src", "bindings", "tests", "benchmarks")
        for path in files(folder)
        for function in functions_in(path.read_text(encoding="utf-8"))
        if function.lines > LONGEST_FUNCTION
    }
    assert set(long) == set(LONG_FUNCTIONS), long


def test_no_public_function_has_many_parameters() -> None:
    many = {
        f"{path.relative_to(NATIVE)} {function.name}": function.parameters
        for path in files("include/pointmorph")
        for function in functions_in(path.read_text(encoding="utf-8"))
        if function.parameters > MOST_PARAMETERS
    }
    assert many == {}


# --- Pages of stages

SECTIONS = ["Use", "Options", "Deviations from the paper", "Guarantees"]
PAGES = sorted((ROOT / "docs" / "stages").glob("*/*.md"))


class Field(NamedTuple):
    kind: str
    default: str


def split_outside(text: str, separator: str) -> list[str]:
    """Parts between the separators that stand outside of all brackets."""
    parts, depth = [""], 0
    for c in text:
        depth += (c in "({[<") - (c in ")}]>")
        if c == separator and depth == 0:
            parts.append("")
        else:
            parts[-1] += c
    return parts


def fields_of_options(header: str) -> dict[str, Field]:
    """Fields of every struct whose name ends in Options."""
    fields = {}
    for body in re.findall(r"struct \w*Options \{(.*?)\n\};", without_comments(header), re.DOTALL):
        for statement in split_outside(body, ";"):
            if "(" in re.split("[={]", statement)[0] or not statement.strip():
                continue
            kind = ""
            for declared in split_outside(statement.strip(), ","):
                field = re.fullmatch(
                    r"(.*?)(\w+)\s*(?:=\s*(.*)|(\{.*\}))?", declared.strip(), re.DOTALL
                )
                assert field, declared
                kind = field[1].strip() or kind
                fields[field[2]] = Field(kind, field[3] or field[4] or "")
    return fields


def option_rows(page: str) -> list[tuple[list[str], str]]:
    """Of each row of the options' tables: the options, and what is said of their defaults."""
    section = page.partition("\n## Options\n")[2].partition("\n## ")[0]
    rows = []
    for table in re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE):
        header, rule, *lines = table.splitlines()
        assert (header, rule) == ("| option | meaning | default |", "|---|---|---|")
        for line in lines:
            option, _, default = (cell.strip() for cell in line.strip("|").split("|"))
            names = re.findall(r"`(\w+)`", re.sub(r"\(.*?\)", "", option))
            rows.append((names, default))
    return rows


def numbers(text: str) -> list[float]:
    text = re.sub(r"\[.*?\]\(.*?\)", "", text).replace("\N{MINUS SIGN}", "-")
    return [float(n) for n in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def is_default(said: str, fields: list[Field]) -> bool:
    """Whether a cell says the defaults of the fields, as far as a header has them."""
    if all(field.default in ("true", "false") for field in fields):
        return said.split(", ") == [field.default for field in fields]
    if said.startswith("see "):
        return all("{" in f.default or f.kind.endswith("Options") for f in fields)
    schedules = all(field.kind == "RegistrationLevel" for field in fields)
    most = 4 if schedules else None
    found = [number for field in fields for number in numbers(field.default)[:most]]
    return numbers(said) == found if found else said != ""


def test_options_are_read() -> None:
    header = (
        "struct XOptions {\n    /// Of a; b.\n    double a = 1.0, b = 2.5e-3;\n"
        "    std::optional<int> c{};\n    int d() const;\n    bool e = true;\n    YOptions y;\n"
        "    std::vector<Level> f{{.first = 1},\n                         {.first = 2}};\n};\n"
    )
    fields = fields_of_options(header)
    assert list(fields) == ["a", "b", "c", "e", "y", "f"]
    assert fields["b"] == Field("double", "2.5e-3")
    head = "\n| option | meaning | default |\n|---|---|---|\n"
    first, second = head + "| `a` (`x_a`) | `z` | 1 |\n", head + "| `b`, `c` | | 2 |\n"
    page = f"\n## Options\n{first}\nAnd:\n{second}\n## Guarantees\n{head}"
    assert option_rows(page) == [(["a"], "1"), (["b", "c"], "2")]
    with pytest.raises(AssertionError):
        option_rows(page.replace("| option", "| name", 1))


@pytest.mark.parametrize(
    ("names", "said", "wrong"),
    [
        ("a", "1", "1.5"),
        ("a b", "1, 2.5e-3", "1"),
        ("m", "\N{MINUS SIGN}0.1", "0.1"),
        ("e", "true", "yes"),
        ("y", "see [y](y2.md)", ""),
        ("c", "from the spacing", ""),
        ("f", "1, 2", "2, 1"),
        ("f", "see above", ""),
        ("a", "1", "see above"),
        ("l", "2 stiff rounds, 8 more, stiffness 10 → 1.5", "2 stiff rounds, 8 more"),
    ],
)
def test_a_wrong_default_is_noticed(names: str, said: str, wrong: str) -> None:
    known = {
        "a": Field("double", "1.0"),
        "b": Field("double", "2.5e-3"),
        "c": Field("std::optional<double>", "{}"),
        "e": Field("bool", "true"),
        "f": Field("std::vector<Level>", "{{.first = 1}, {.first = 2}}"),
        "l": Field("RegistrationLevel", "{.a1 = 2, .b = 8, .c = 10.0, .d = 1.5, .e = 7}"),
        "m": Field("double", "-0.1"),
        "y": Field("YOptions", ""),
    }
    fields = [known[name] for name in names.split()]
    assert is_default(said, fields)
    assert not is_default(wrong, fields)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_a_page_follows_the_template(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    room, stem = page.parent.name, page.stem
    assert text.startswith(f"# {stem}\n")
    headings = re.findall(
        r"^## (.+)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE
    )
    assert [h for h in headings if h in SECTIONS] == SECTIONS
    intro = text.partition("\n## ")[0]
    for kind in (f"{stem}.hpp", f"{stem}.cpp", f"test_{stem}.cpp"):
        assert f"[`{kind}`]" in intro
    assert "```cpp\n" in text.partition("\n## Use\n")[2].partition("\n## ")[0]
    folder = NATIVE / "include" / "pointmorph" / room
    parts = [p for p in sorted(folder.glob("*.hpp")) if stem in (p.stem, stage_of_part(p))]
    fields = fields_of_options("\n".join(p.read_text(encoding="utf-8") for p in parts))
    rows = option_rows(text)
    assert sorted(name for names, _ in rows for name in names) == sorted(fields)
    wrong = [row for row in rows if not is_default(row[1], [fields[name] for name in row[0]])]
    assert wrong == []


# --- The signatures and the example on a page

EXAMPLE = re.compile(r"^TEST\(Example, (\w+)\) \{$(.*?)^\}$", re.MULTILINE | re.DOTALL)
MARKED = re.compile(r"// --- example\n(.*?)// --- end of the example\n", re.DOTALL)


def condensed(code: str) -> str:
    """The code without comments and white space."""
    return re.sub(r"/\*.*?\*/|//[^\n]*|\s+", "", code, flags=re.DOTALL)


def signatures_and_example(page: str) -> tuple[list[str], str]:
    """What stands before the first empty line under Use, declaration by declaration, and after."""
    use = page.partition("\n## Use\n")[2].partition("\n## ")[0]
    signatures, _, example = use.partition("```cpp\n")[2].partition("```")[0].partition("\n\n")
    return [s for s in condensed(signatures).split(";") if s], condensed(example)


def is_declared(signature: str, header: str) -> bool:
    """As a declaration, or with its body; constructors, with what they initialize."""
    before = "".join(f"|(?<={word})" for word in ("explicit", "inline", "static", "constexpr"))
    pattern = rf"(?:(?<!\w){before}){re.escape(signature)}[;{{:]"
    return re.search(pattern, condensed(header)) is not None


def test_signatures_and_examples_are_read() -> None:
    page = (
        "# s\n\n## Use\n\n```cpp\nint f(int a,\n      int b);\nvoid g();\n\nf(1, 2);  // 3\n```\n"
    )
    assert signatures_and_example(page) == (["intf(inta,intb)", "voidg()"], "f(1,2);")
    assert is_declared("intf(inta)", "/// Of a.\nint f(int a);\n")
    assert is_declared("intf(inta)", "inline int f(int a) {\n    return a;\n}\n")
    assert not is_declared("intf(inta)", "int f(int a, int b);\n")
    assert not is_declared("f(inta)", "class gf {\n    gf(int a);\n};\n")
    assert not is_declared("intf(inta)", "int f(int a) const;\n")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_a_page_has_signatures_of_the_header(page: Path) -> None:
    signatures, _ = signatures_and_example(page.read_text(encoding="utf-8"))
    room, stem = page.parent.name, page.stem
    headers = [NATIVE / "include" / "pointmorph" / room / f"{stem}.hpp"]
    if room == "morph":  # whose stages are methods of Morph
        headers.append(headers[0].with_name("morph.hpp"))
    header = "\n".join(path.read_text(encoding="utf-8") for path in headers)
    assert signatures
    assert [s for s in signatures if not is_declared(s, header)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_a_page_s_example_runs_as_a_test(page: Path) -> None:
    _, example = signatures_and_example(page.read_text(encoding="utf-8"))
    source = NATIVE / "tests" / page.parent.name / f"test_{page.stem}.cpp"
    tests = EXAMPLE.findall(source.read_text(encoding="utf-8"))
    assert [name for name, _ in tests] == ["".join(word.title() for word in page.stem.split("_"))]
    body = tests[0][1]
    marked = MARKED.findall(body)
    assert [condensed(lines) for lines in marked] == [example]
    assert re.search(r"\b(EXPECT|ASSERT)_", body.partition("// --- end of the example")[2])


# --- Pictures

IMAGES = ROOT / "docs" / "images"
SCRIPT = ROOT / "docs" / "make_pictures.py"
DRAWN = {
    name: path.stem
    for path in sorted((ROOT / "docs" / "stage_pictures").glob("*.py"))
    for name in re.findall(r"^@picture\ndef (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
}
"""The room of each picture."""


def assert_fits_a_page(picture: Path) -> None:
    data = picture.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(data) <= 60_000
    assert int.from_bytes(data[16:20]) == 900  # its width


@pytest.mark.parametrize("page", PAGES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_a_page_shows_the_picture_that_is_drawn_of_its_stage(page: Path) -> None:
    shown = re.findall(r"^!\[(.+)\]\((.+)\)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert [link for _, link in shown] == [f"../../images/{page.stem}.png"]
    assert DRAWN[page.stem] == page.parent.name
    assert_fits_a_page(IMAGES / f"{page.stem}.png")


OTHERS = {
    "bench_growth.png": "native/benchmarks/draw_growth.py",
    "peers_at_scale.png": "native/benchmarks/peers_at_scale.py",
    "calf_to_koala.png": "docs/demo/head_picture.py",
    "compare_*.png": "native/benchmarks/compare_pictures.py",
    "resampling_*.png": "docs/demo/cracks.py",
    "template_onto_20.png": "docs/demo/twenty_models.py",
    "wrapped_*.png": "docs/make_wrapped_pictures.py",
}
"""What draws the pictures of other pages."""


def test_every_picture_is_drawn_by_a_script_and_shown_on_a_page() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    shown = [
        (page.parent / link).resolve()
        for page in pages
        for link in re.findall(r"!\[.*?\]\((.+?)\)", page.read_text(encoding="utf-8"))
    ]
    drawn = {IMAGES / f"{name}.png" for name in DRAWN}
    for pattern, script in OTHERS.items():
        assert (ROOT / script).is_file()
        found = set(IMAGES.glob(pattern))
        assert found
        drawn |= found
    pictures = set(IMAGES.iterdir())
    assert pictures == drawn
    assert pictures <= set(shown)


LIBRARY = ROOT / "build" / "wheel" / "libpointmorph_core.a"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pictures lie that were drawn now, as many of two as can be, by one process."""
    for module in ("matplotlib", "scipy"):  # .venv has them; other Pythons needn't
        pytest.importorskip(module)
    folder = tmp_path_factory.mktemp("pictures")
    names = ["motion", *(["lod"] if LIBRARY.is_file() else [])]
    subprocess.run([sys.executable, SCRIPT, "--folder", folder, *names], check=True)
    return folder


@pytest.mark.parametrize("name", ["motion", "lod"])
def test_pictures_are_drawn_by_script(name: str, drawn: Path) -> None:
    if name == "lod" and not LIBRARY.is_file():
        pytest.skip("the library that its stage is compiled against isn't built here")
    assert_fits_a_page(drawn / f"{name}.png")
