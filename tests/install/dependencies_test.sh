#!/bin/sh
# packages.txt and docs/dependencies.md list the same packages in the same groups. Run as: dependencies_test.sh ROOT
set -u
listed=$(sed -n 's/^\([a-z][a-z]*\)  *\([^ |]*\).*/\2 \1/p' "$1/packages.txt" | sort)
# shellcheck disable=SC2016 # the back quotes are those of the table
explained=$(sed -n 's/^| `\([^`]*\)` | \([a-z]*\) |.*/\1 \2/p' "$1/docs/dependencies.md" | sort)
[ -n "$listed" ] && [ "$listed" = "$explained" ] && exit 0
echo 'packages.txt and docs/dependencies.md differ.'
printf 'In packages.txt:\n%s\n\nIn docs/dependencies.md:\n%s\n' "$listed" "$explained"
exit 1
