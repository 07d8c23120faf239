"""`rc completion`: the script by which a shell completes command lines."""

from __future__ import annotations

import argparse

from .common import FINE
from .completing import ASKED

NAME = "completion"

_EXAMPLES = """\
examples:
  eval "$(rc completion bash)"                                       in ~/.bashrc
  eval "$(rc completion zsh)"                                        in ~/.zshrc, behind compinit
  rc completion fish > ~/.config/fish/completions/rc.fish            once; the same for rcgen.fish, rcdeploy.fish
  rc completion bash > ~/.local/share/bash-completion/completions/rc    ... instead, with bash-completion

The script completes rc, rcgen and rcdeploy: commands, options, files by their kind, and the names of what runs now.
It asks the program that stands on the command line, so it fits every version.

exit status: 0 done, 2 usage
"""

_BASH = """\
_robocomp() {
    local IFS=$'\\n'
    COMPREPLY=($(ASKED=bash "$1" "${COMP_LINE:0:COMP_POINT}" 2>/dev/null))
    [[ ${#COMPREPLY[@]} -ne 0 ]] || return
    if [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[/=] ]]; then compopt -o nospace; fi
    local index
    for index in "${!COMPREPLY[@]}"; do printf -v "COMPREPLY[index]" %q "${COMPREPLY[index]}"; done
}
complete -F _robocomp rc rcgen rcdeploy
"""

_ZSH = """\
#compdef rc rcgen rcdeploy
_robocomp() {
    local line
    local -a whole whole_shown open open_shown
    for line in "${(@f)$(ASKED=zsh ${~words[1]} "${(@Q)words[2,CURRENT]}" 2>/dev/null)}"; do
        local text=${line%%$'\\t'*} shown=${line/$'\\t'/  -- }
        if [[ -z $text ]]; then continue; fi
        if [[ $text == *[/=] ]]; then open+=("$text") open_shown+=("$shown")
        else whole+=("$text") whole_shown+=("$shown"); fi
    done
    compadd -l -d whole_shown -a whole
    compadd -l -S '' -d open_shown -a open
}
compdef _robocomp rc rcgen rcdeploy
"""

_FISH = """\
function __robocomp_complete
    set -l words (commandline -opc)
    ASKED=fish $words[1] $words[2..] (commandline -ct) 2>/dev/null
end
for name in rc rcgen rcdeploy
    complete -c $name -f -a '(__robocomp_complete)'
end
"""

_SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Print the script by which a shell completes the command lines of rc, rcgen and rcdeploy."
    to.epilog = _EXAMPLES
    to.add_argument("shell", choices=tuple(_SCRIPTS), metavar="SHELL", help=", ".join(_SCRIPTS))


def run(options: argparse.Namespace) -> int:
    print(_SCRIPTS[options.shell].replace("ASKED", ASKED), end="")
    return FINE
