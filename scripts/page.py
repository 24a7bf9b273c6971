"""Writes tables in Markdown, and puts them between the marks of a page: `<!-- begin NAME -->` and `<!-- end -->`."""

import re


def markdown(head, rows):
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in [head, ["---"] * len(head), *rows])


def insert(text, name, table, page):
    """Returns the page's text with the table in place; ends the program if the page has no such marks."""
    text, count = re.subn(rf"(<!-- begin {name} -->\n).*?(<!-- end -->)",
                          lambda match: match[1] + table + "\n" + match[2], text, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{page}: no table {name}")
    return text
