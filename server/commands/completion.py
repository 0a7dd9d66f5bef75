"""Completion of commands and options for bash, zsh and fish: `imuscope completion SHELL`.

The scripts are generated from the parser: commands, options, and the values of options with few of them. Everything
else is completed as a file name, because most sources are files.

argcomplete is not used: it starts the program at each Tab, which takes 0.4 to 2 s (Python alone 0.01 s), and these
scripts none. shtab, which generates scripts too, is under the MPL 2.0, which is not permissive.
"""

import argparse
import shlex
from collections.abc import Iterator, Mapping

from imuscope.protocols.family.plugins import protocol_names


def script(commands: Mapping[str, argparse.ArgumentParser], shell: str) -> str:
    """The script for a shell: "bash", "zsh" or "fish"."""
    lines = {"bash": _bash, "zsh": _zsh, "fish": _fish}[shell](commands)
    return "\n".join(lines) + "\n"


def _options(command: argparse.ArgumentParser) -> list[argparse.Action]:
    """Options that the `--help` of a command shows."""
    return [one for one in command._actions if one.option_strings and one.help != argparse.SUPPRESS]


def _values(command: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Options with a few values, and those values."""
    for action in _options(command):
        if action.choices:
            yield "|".join(action.option_strings), " ".join(map(str, action.choices))
        if "--protocol" in action.option_strings:
            yield "--protocol", " ".join(("auto", *protocol_names()))


def _words(command: argparse.ArgumentParser) -> str:
    return " ".join(name for action in _options(command) for name in action.option_strings)


def _cases(commands: Mapping[str, argparse.ArgumentParser], before: str, values: str, words: str) -> Iterator[str]:
    """Completion cases of bash and zsh: the values of a command's option, and its options.

    Args:
        before: the command and the previous word, in the shell's syntax.
        values, words: shell code that completes {words}; `words` only applies to a begun option.
    """
    yield f'    case "{before}" in'
    for name, command in commands.items():
        for option, known in _values(command):
            patterns = "|".join(f'"{name} {one}"' for one in option.split("|"))
            yield f"        {patterns}) {values.format(words=known)}; return ;;"
    yield "    esac"
    yield f'    case "{before.split()[0]}" in'
    for name, command in commands.items():
        yield f"        {name}) {words.format(words=_words(command))} ;;"
    yield "    esac"


def _bash(commands: Mapping[str, argparse.ArgumentParser]) -> Iterator[str]:
    yield "_imuscope() {"
    yield '    local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" command="${COMP_WORDS[1]}"'
    yield "    COMPREPLY=()"
    yield '    if [ "$COMP_CWORD" -eq 1 ]; then'
    yield f'        COMPREPLY=($(compgen -W "{" ".join(commands)} --help --version" -- "$word")'
    yield '            $(compgen -f -- "$word"))'
    yield "        return"
    yield "    fi"
    reply = 'COMPREPLY=($(compgen -W "{words}" -- "$word"))'
    yield from _cases(commands, "$command $before", reply, f'[[ "$word" == -* ]] && {reply}')
    yield '    [[ "$word" == -* ]] || COMPREPLY=($(compgen -f -- "$word"))'
    yield "}"
    yield "complete -o filenames -F _imuscope imuscope"


def _zsh(commands: Mapping[str, argparse.ArgumentParser]) -> Iterator[str]:
    yield "#compdef imuscope"
    yield "_imuscope() {"
    yield "    local -a commands"
    yield f"    commands=({' '.join(commands)})"
    yield "    if (( CURRENT == 2 )); then compadd -a commands; _files; return; fi"
    begun = '[[ "$PREFIX" == -* ]] && compadd -- {words}'
    yield from _cases(commands, "$words[2] $words[CURRENT-1]", "compadd {words}", begun)
    yield '    [[ "$PREFIX" == -* ]] || _files'
    yield "}"
    yield "compdef _imuscope imuscope"


def _fish(commands: Mapping[str, argparse.ArgumentParser]) -> Iterator[str]:
    for name in commands:
        yield f"complete -c imuscope -n __fish_use_subcommand -a {name}"
    for name, command in commands.items():
        known = dict(_values(command))
        for action in _options(command):
            parts = [f"complete -c imuscope -n '__fish_seen_subcommand_from {name}'"]
            parts += [f"-l {one[2:]}" if one.startswith("--") else f"-s {one[1:]}" for one in action.option_strings]
            values = known.get("|".join(action.option_strings), "")
            parts += [f"-x -a {shlex.quote(values)}"] if values else ["-r"] * (action.nargs != 0)
            words = (action.help or "").replace("%%", "%")
            yield " ".join([*parts, f"-d {shlex.quote(words)}"])
