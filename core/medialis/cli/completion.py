"""Completion for shells: commands, options and choices, without starting medialis at each key."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

from medialis.cli.arguments import EXIT_OK, SHELLS, build_parser
from medialis.cli.display import say
from medialis.operations.names import named_operations
from medialis.surface.samples import SAMPLES

Words = Mapping[str, Sequence[str]]

_BASH = """\
# medialis completion bash > ~/.local/share/bash-completion/completions/medialis
_medialis() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "${{COMP_WORDS[1]}} ${{COMP_WORDS[COMP_CWORD-1]}}" in
{choices}
        *) case "${{COMP_WORDS[1]}}" in
{options}
            esac
            [ "${{word#-}}" = "$word" ] && words="" ;;
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
    [ ${{#COMPREPLY[@]}} -eq 0 ] && COMPREPLY=($(compgen -f -- "$word"))
}}
complete -o filenames -F _medialis medialis
"""

_ZSH = """\
#compdef medialis
# in ~/.zshrc: source <(medialis completion zsh)
autoload -U +X bashcompinit && bashcompinit
"""


def print_script(options: argparse.Namespace) -> int:
    """Print the script that a shell reads."""
    say(completion_script(options.shell).removesuffix("\n"))
    return EXIT_OK


def completion_script(shell: str) -> str:
    """Return the script for one of `SHELLS`.

    Examples
    --------
    >>> "thickness" in completion_script("bash")
    True
    """
    commands, choices = _known()
    if shell == "fish":
        return _fish(commands, choices)
    options = "\n".join(_case(command, words) for command, words in commands.items())
    values = "\n".join(_case(f'"{place}"', words) for place, words in choices.items())
    script = _BASH.format(commands=" ".join(commands), options=options, choices=values)
    return _ZSH + script if shell == "zsh" else script


def _case(pattern: str, words: Sequence[str]) -> str:
    return f'        {pattern}) words="{" ".join(words)}" ;;'


def _fish(commands: Words, choices: Words) -> str:
    """Return one line for each command and each option."""
    lines = ["# medialis completion fish > ~/.config/fish/completions/medialis.fish"]
    lines += [f"complete -c medialis -n __fish_use_subcommand -a {name}" for name in commands]
    for command, options in commands.items():
        here = f"complete -c medialis -n '__fish_seen_subcommand_from {command}'"
        if first := choices.get(f"{command} {command}"):
            lines.append(f"{here} -x -a '{' '.join(first)}'")
        for option in options:
            words = choices.get(f"{command} {option}")
            values = f" -x -a '{' '.join(words)}'" if words else ""
            lines.append(f"{here} -l {option.removeprefix('--')}{values}")
    return "\n".join(lines) + "\n"


def _known() -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return the options of each command, and the words that an option of a command may have."""
    from medialis.cli.commands import COMMANDS

    parser = build_parser(lambda _: EXIT_OK, COMMANDS, every=True)
    group = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    commands: dict[str, list[str]] = {}
    choices: dict[str, list[str]] = {}
    operations = [named.command for named in named_operations()]
    first = {"completion": SHELLS, "sample": SAMPLES, "batch": operations, "describe": operations}
    choices.update({f"{name} {name}": list(words) for name, words in first.items()})
    for name, sub in group.choices.items():
        commands[name] = []
        for action in sub._actions:
            long = [option for option in action.option_strings if option.startswith("--")]
            commands[name] += long
            words = action.choices or _listed(action.metavar)
            choices.update({f"{name} {option}": list(map(str, words)) for option in long if words})
    return commands, choices


def _listed(metavar: object) -> list[str]:
    """Return the words of a metavar such as {auto,off}."""
    text = metavar if isinstance(metavar, str) else ""
    return text[1:-1].split(",") if text.startswith("{") else []
