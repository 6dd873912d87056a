"""Python text from templates."""

from collections.abc import Mapping


def filled_in(template: str, lines: Mapping[str, list[str]], **words: str) -> str:
    """The template with words in its lines, and with several lines, or none, in place of a line."""
    text = []
    for line in template.splitlines():
        name = line.strip()[1:-1]
        if line.strip() == f"{{{name}}}" and name in lines:
            text += [line[: len(line) - len(line.lstrip())] + part for part in lines[name]]
        else:
            text.append(line.format(**words))
    return "\n".join(text) + "\n"
