"""The tables of the grammars, beside each of them. `python -m tests.dsl.tables` writes them."""

from __future__ import annotations

from robocomp_py.dsl.tables import make, read_grammar, tables_file, text_of

LANGUAGES = ("idsl", "cdsl", "pdsl", "ddsl", "smdsl")
"""Those that have a grammar."""


def main() -> None:
    for language in LANGUAGES:
        grammar = read_grammar(language)
        tables_file(language).write_text(text_of(grammar, make(grammar)), encoding="utf-8")


if __name__ == "__main__":
    main()
