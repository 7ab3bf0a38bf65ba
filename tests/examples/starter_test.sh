#!/bin/sh
# A starter of examples/, built and checked by the very commands of its line in examples/README.md, in a copy of the checkout's
# folders that these need. Run as: starter_test.sh FILE KFSTAB SOURCE. Skipped (77) where the language is not there.
set -u
file=$1 kfstab=$2 source=$3
# Where rustup puts what it installs.
PATH=$PATH:${HOME:-/root}/.cargo/bin

line=$(grep "^| \`$file\` |" "$source/examples/README.md") || {
  echo "examples/README.md has no line for $file"
  exit 1
}
# | file | needs | build | check |
cell() { printf '%s\n' "$line" | cut -d'|' -f"$1" | sed 's/^[[:space:]]*`\{0,1\}//; s/`\{0,1\}[[:space:]]*$//'; }
build=$(cell 4) check=$(cell 5)

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/examples"
cp "$source/examples/"* "$scratch/examples/"
ln -s "$source/properties" "$scratch/properties"
ln -s "$kfstab" "$scratch/kfstab"
cd "$scratch/examples" || exit 1

# What runs it: the first word of the build, or of what is checked.
runs=${build:-$(printf '%s\n' "$check" | sed "s/.*--exec '\{0,1\}//")}
runs=${runs%% *}
case $runs in
  ./*) ;;
  *) command -v "$runs" >/dev/null || {
    echo "skipped: there is no $runs"
    exit 77
  } ;;
esac

if [ -n "$build" ]; then
  echo "+ $build"
  sh -c "$build" || exit 1
fi
echo "+ $check"
# 50 cases, of what kind it is is not asked: in a hurry, as a first try would be.
KFSTAB_QUICK=1 sh -c "$check" >printed 2>&1
status=$?
cat printed
[ "$status" -eq 0 ] || exit 1
grep -q '^[1-9][0-9]* passed, 0 failed$' printed || exit 1
grep -q ' 50 of 50 cases' printed
