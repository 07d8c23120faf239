"""Texts that mean something if they are not quoted: code, options, marks, ends of lines."""

from __future__ import annotations

from hypothesis import strategies as st

NASTY = (
    '"""',
    "'''",
    "\\",
    "\\\\",
    "\\N{BULLET} \\x41 \\u0041 \\777",
    "' + __import__('os').system('touch owned') + '",
    '"; import os; os.system("touch owned"); "',
    "\nimport os\nos.system('touch owned')\n",
    "\rimport os\r",
    "\r\nimport os\r\n",
    "\x0b\x0c\x1c\x1d\x1e\x85import os",
    "\u2028import os\u2029import os",
    "{{ 7 * 7 }}{% raw %}{# #}",
    "%s %(name)s %n {0} {name} {__class__}",
    "$(touch owned) `touch owned` ${HOME} $HOME",
    "; touch owned; | touch owned & touch owned",
    "*/ touch /*",
    "//",
    "# ]]",
    "]\n[params]\nowned = true",
    "<!-- --> ]]> </text><script>owned()</script><style>",
    "]]><script>owned()<style>",
    "'><a href='javascript:owned()' onclick='owned()'>",
    "&lt;&#60;&amp;",
    "--help",
    "-rf",
    "../../../../etc/passwd",
    "~root/x",
    "|bar",
    "end\n    click owned call owned()",
    '\\n"]; owned [label="',
    "\u202e\u2066\u200b\ufeff",
    "\x1b[2J\x1b]0;owned\x07",
    "\x00",
    "é ﬁ ß İ ☃",
)
"""In this order: ends of texts of Python, of lines, of templates, of shells, of other languages, of terminals."""

FOR_QUOTES = tuple(each.replace('"', "'").replace("\n", " ") for each in NASTY if "\x00" not in each)
"""What of them can stand in the quotes of our languages, which know neither quotes nor new lines in there."""

FOR_COMMENTS = tuple(each.replace("*/", "* /") for each in NASTY)
"""What of them can stand between `/*` and `*/`."""

texts_for_quotes = st.text(st.characters(exclude_characters='"\n\x00', exclude_categories=["Cs"]), max_size=60)
texts_for_comments = st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), max_size=60).map(
    lambda text: text.replace("*/", "* /").rstrip("*/")
)
