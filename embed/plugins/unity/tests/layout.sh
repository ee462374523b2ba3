#!/usr/bin/env bash
# Prints sizes, offsets and constants of surefoot.h, for LayoutTests: a C program is made of the header's own lines, and run.
#
#   layout.sh HEADER FOLDER     the folder gets the program
set -euo pipefail
header=$1 folder=$2
{
    echo '#include "surefoot.h"'
    echo '#include <stdio.h>'
    echo 'int main(void) {'
    awk '
        /^typedef struct sf_[a-z0-9_]+ \{/ { name = $3; printf "printf(\"size %s %%zu\\n\", sizeof(%s));\n", name, name }
        /^\} sf_/ { name = "" }
        name != "" && /^    [a-z].*;$/ {
            field = $NF
            gsub(/[*;]|\[.*/, "", field)
            printf "printf(\"offset %s %s %%zu\\n\", offsetof(%s, %s));\n", name, field, name, field
        }
        /^(    |enum \{ )SF_[A-Z_]+ = / {
            line = $0
            while (match(line, /SF_[A-Z_]+ = /)) {
                constant = substr(line, RSTART, RLENGTH - 3)
                printf "printf(\"constant %s %%d\\n\", (int)%s);\n", constant, constant
                line = substr(line, RSTART + RLENGTH)
            }
        }
    ' "$header"
    echo 'return 0; }'
} >"$folder/layout.c"
cc -std=c99 -I "$(dirname "$header")" "$folder/layout.c" -o "$folder/layout"
"$folder/layout"
