"""The scripts of `srprov completion`, one for each shell. They are data: what they offer, `completion_line` says.

Each asks the `srprov` of the PATH, never a program that is only being typed, and takes words, or leaves names of files
to the shell.
"""

from __future__ import annotations

_BASH = """\
_srprov_completion() {
    local head="" word
    COMPREPLY=()
    {
        IFS= read -r head
        while IFS= read -r word; do COMPREPLY+=("$word"); done
    } < <(command srprov completion bash -- "${COMP_LINE:0:COMP_POINT}" "$2" 2>/dev/null)
    case "$head" in
        files*) ;;
        folders*) compopt +o default -o dirnames 2>/dev/null ;;
        *nospace) compopt +o default -o nospace 2>/dev/null ;;
        *) compopt +o default 2>/dev/null ;;
    esac
}
complete -o default -F _srprov_completion srprov
"""

_ZSH = """\
#compdef srprov
_srprov() {
    local head word
    local -a words_only shown more
    {
        IFS= read -r head
        while IFS= read -r word; do
            words_only+=("${word%%$'\\t'*}")
            shown+=("${word//$'\\t'/  -- }")
        done
    } < <(command srprov completion zsh -- "${(@)words[1,CURRENT]}" 2>/dev/null)
    [[ "$head" == *nospace ]] && more=(-S '')
    case "$head" in
        files*) compset -P '--*='; _files; return ;;
        folders*) compset -P '--*='; _files -/; return ;;
    esac
    compadd -l "${more[@]}" -d shown -a -- words_only
}
if [[ "${funcstack[1]}" == _srprov ]]; then _srprov "$@"; else compdef _srprov srprov; fi
"""

_FISH = """\
function __srprov_completion
    set -l lines (command srprov completion fish -- (commandline -opc) (commandline -ct) 2>/dev/null)
    set -l token (commandline -ct)
    switch "$lines[1]"
        case 'files*'
            __fish_complete_path "$token"
        case 'folders*'
            __fish_complete_directories "$token"
        case '*'
            for line in $lines[2..-1]
                printf '%s\\n' $line
            end
    end
end
complete -c srprov -f -a '(__srprov_completion)'
"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}
