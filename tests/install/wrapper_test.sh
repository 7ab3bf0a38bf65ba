#!/bin/sh
# What ./kfstab does on machines of every kind. All that it calls is a fake that notes how it was called, in a PATH
# which holds nothing else, so that this runs anywhere in seconds. Run as: wrapper_test.sh ROOT
set -u
wrapper=$1/kfstab
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
failures=0

tools='awk basename cat cksum cut dirname env flock grep head ls mkdir mktemp mv nproc readlink rm rmdir sed sh sleep stty tail tr'

fake() { cat >"$PATH_OF_FAKES/$1" && chmod +x "$PATH_OF_FAKES/$1"; }

# A checkout in a folder with spaces, and a machine on which `installed` is installed.
machine() {
  rm -rf "$scratch/machine"
  home=$scratch/machine/home tree="$scratch/machine/a checkout" PATH_OF_FAKES=$scratch/machine/bin
  calls=$scratch/machine/calls installed=$scratch/machine/installed
  mkdir -p "$home" "$tree" "$PATH_OF_FAKES"
  : >"$calls"
  cp "$wrapper" "$tree/"
  echo '{}' >"$tree/CMakePresets.json"
  printf '%s\n' '# a comment' 'build one the first' 'build  two|deux|zwei  any of three' 'test three for tests' \
    'benchmark four to compare with' 'later five not now' >"$tree/packages.txt"
  printf '%s\n' one two three >"$installed"
  for tool in $tools; do ln -s "$(command -v "$tool")" "$PATH_OF_FAKES/$tool"; done
  fake dpkg-query <<END
#!/bin/sh
shift 3
for p; do grep -qx "\$p" "$installed" && echo "\$p installed" || echo "\$p not-installed"; done
END
  fake apt-get <<END
#!/bin/sh
echo "apt-get \$* (\$DEBIAN_FRONTEND)" >>"$calls"
[ ! -f "$scratch/machine/offline" ] || { echo 'no network'; exit 100; }
case \$* in *install*) for p; do case \$p in one | two | deux | zwei | three | four) echo "\$p" >>"$installed" ;; esac; done ;; esac
END
  fake cmake <<END
#!/bin/sh
echo "cmake \$*" >>"$calls"
[ ! -f "$scratch/machine/no-libraries" ] || { echo 'could not find Eigen3'; exit 1; }
while [ "\$1" != -B ]; do shift; done
: >"\$2/build.ninja"
END
  fake ninja <<END
#!/bin/sh
echo "ninja \$*" >>"$calls"
[ ! -f "$scratch/machine/broken" ] || { echo 'error: expected a semicolon'; exit 1; }
mkdir "$scratch/machine/building" || { echo two at once >>"$calls"; exit 1; }
[ ! -f "$scratch/machine/slow" ] || sleep 0.3
rmdir "$scratch/machine/building"
mkdir -p "\$2/bin"
cat "$scratch/machine/program" >"\$2/bin/kfstab.new"
case \$5 in *benchmark) program=\$5 ;; *) program=kfstab ;; esac
mv "\$2/bin/kfstab.new" "\$2/bin/\$program"
chmod +x "\$2/bin/\$program"
END
  fake id <<'END'
#!/bin/sh
echo 0
END
  fake chmod <<END
#!/bin/sh
exec $(command -v chmod) "\$@"
END
  cat >"$scratch/machine/program" <<'END'
#!/bin/sh
printf '%s:' "$PWD"
printf ' [%s]' "$@"
echo
exit "${PROGRAM_EXIT:-0}"
END
}

# kfstab ARGUMENTS...: sets out, err, code. The caller sets `as` to run it by another name or in another folder.
kfstab() {
  out=$(cd "${stand:-$tree}" && env -i PATH="$PATH_OF_FAKES" HOME="$home" PROGRAM_EXIT="${program_exit:-0}" \
    KFSTAB_BUILD_DIR="${build_dir:-}" sh "${as:-$tree/kfstab}" "$@" 2>"$scratch/err" </dev/null)
  code=$?
  err=$(grep -v ' (log: ' "$scratch/err") # what it says when it takes long: on a busy machine anything does
}

check() { # check WHAT GOT WANTED, a shell pattern
  # shellcheck disable=SC2254 # it is a pattern
  case $2 in
    $3) ;;
    *)
      failures=$((failures + 1))
      printf 'FAILED %s: %s\n  got:    %s\n  wanted: %s\n  stderr: %s\n' "$name" "$1" "$2" "$3" "${err:-}"
      ;;
  esac
}
count() { grep -c -- "$1" "$calls"; }

name='everything is there'
machine
program_exit=7
kfstab run 'a system' --steps 5
check 'exit code' "$code" 7
check 'stdout' "$out" "$tree: ?run? ?a system? ?--steps? ?5?"
check 'stderr' "$err" ''
check 'packages left alone' "$(count apt-get)" 0
check 'builds the program only' "$(cat "$calls")" '*ninja*kfstab_tool'
program_exit=0
kfstab list
check 'a second run does not configure' "$(count cmake)" 1
check 'but it builds' "$(count ninja)" 2

name='from another folder, through a symbolic link'
machine
mkdir "$scratch/machine/elsewhere" "$scratch/machine/bin of a user"
ln -s "$tree/kfstab" "$scratch/machine/bin of a user/kfstab"
stand=$scratch/machine/elsewhere as="$scratch/machine/bin of a user/kfstab"
kfstab demo
check 'exit code' "$code" 0
check 'stdout' "$out" "$stand: ?demo?"
check 'built beside the wrapper' "$(ls "$tree/build/bin")" kfstab
build_dir=here
kfstab demo
check 'a relative build folder is relative to the user' "$(ls "$stand/here/bin")" kfstab
stand='' as='' build_dir=''

name='packages are missing'
machine
: >"$installed"
kfstab demo
check 'exit code' "$code" 0
check 'installs in order, and of its group only' "$(cat "$calls")" \
  '*apt-get*update*apt-get*install -y --no-install-recommends one two (noninteractive)*cmake*'
check 'says so' "$err" '*one two*'
kfstab test
check 'the tests bring their group' "$(cat "$calls")" '*no-install-recommends three (*'

name='an alternative is there'
machine
printf '%s\n' one zwei >"$installed"
kfstab demo
check 'packages left alone' "$(count apt-get)" 0

name='offline, packages missing, and the build can do without'
machine
printf '%s\n' one >"$installed"
: >"$scratch/machine/offline"
kfstab demo
check 'exit code' "$code" 0
check 'shows what apt-get said' "$err" '*no network*could not install: two*'

name='offline, packages missing, and the build cannot do without'
machine
printf '%s\n' one >"$installed"
: >"$scratch/machine/offline"
: >"$scratch/machine/no-libraries"
kfstab demo
check 'exit code' "$code" 3
check 'stdout' "$out" ''
check 'says what to install' "$err" '*could not find Eigen3*install these packages first:*two*'

name='a plain user without sudo'
machine
fake id <<'END'
#!/bin/sh
echo 1000
END
kfstab demo
check 'exit code when all is there' "$code" 0
check 'and not a word' "$err" ''
: >"$installed"
: >"$scratch/machine/no-libraries"
rm -rf "$tree/build"
kfstab demo
check 'exit code' "$code" 3
check 'does not try' "$(count apt-get)" 0
check 'says what to install' "$err" '*cannot install without root or sudo: one two*install these packages first*'

name='a plain user with sudo'
fake sudo <<END
#!/bin/sh
echo "sudo \$*" >>"$calls"
[ "\$1" != -n ] || shift
[ "\$1" = -v ] || exec "\$@"
END
rm "$scratch/machine/no-libraries"
kfstab demo
check 'exit code' "$code" 0
check 'installs through sudo' "$(cat "$calls")" '*sudo*apt-get*install*one two*'

name='neither Debian nor Ubuntu'
machine
rm "$PATH_OF_FAKES/apt-get" "$PATH_OF_FAKES/dpkg-query"
kfstab demo
check 'goes on if it can' "$code" 0
check 'and not a word' "$err" ''
rm -rf "$tree/build"
: >"$scratch/machine/no-libraries"
kfstab demo
check 'exit code' "$code" 3
check 'says what to bring' "$err" '*not Debian or Ubuntu*one two*'
rm "$PATH_OF_FAKES/cmake"
kfstab demo
check 'exit code without CMake' "$code" 3
check 'says what to bring, without CMake too' "$err" '*not Debian or Ubuntu*one two*there is no cmake*'

name='the build fails'
machine
: >"$scratch/machine/broken"
kfstab demo
check 'exit code' "$code" 3
check 'stdout' "$out" ''
check 'shows why, and where there is more' "$err" '*expected a semicolon*kfstab-build.log*'

name='a tree that cannot be written to'
machine
: >"$tree/build"
kfstab demo
check 'exit code' "$code" 0
check 'builds in the cache' "$(ls "$home/.cache/kfstab")" 'a checkout-[0-9]*'
home=/dev/null/home
kfstab demo
check 'exit code without a home' "$code" 3
check 'says what to do' "$err" '*KFSTAB_BUILD_DIR*'

name='two at once'
machine
: >"$scratch/machine/slow"
(kfstab demo) &
(kfstab demo) &
kfstab demo
wait
check 'take turns' "$(count 'two at once')" 0
check 'and all of them build' "$(count ninja)" 3

# ctest REPORT FAILED EXIT: a CTest that leaves these behind.
fake_ctest() {
  printf '%s\n' "$1" >"$scratch/machine/report"
  printf '%s\n' "$2" >"$scratch/machine/failed"
  fake ctest <<END
#!/bin/sh
echo "ctest \$*" >>"$calls"
build=\$2
while [ \$# -gt 0 ]; do
  [ "\$1" != --output-junit ] || cat "$scratch/machine/report" >"\$2"
  shift
done
mkdir -p "\$build/Testing/Temporary"
cat "$scratch/machine/failed" >"\$build/Testing/Temporary/LastTestsFailed.log"
echo 'the output of ctest'
exit $3
END
}
run='<testcase name="a" status="run">' fail='<testcase name="b" status="fail">' notrun='<testcase name="c" status="notrun">'

name='tests that pass'
machine
kfstab list
fake_ctest "$run
$run
$notrun" '' 0
kfstab test some
check 'exit code' "$code" 0
check 'last line' "$out" '*the output of ctest
2 passed, 0 failed, 1 skipped'
check 'configures once more, builds everything, hands on the filter' "$(cat "$calls")" \
  '*cmake*TESTS=OFF*cmake*TESTS=ON*ninja*all*ctest*-R some*'
kfstab list
check 'the folder keeps its tests' "$(count cmake)" 2

name='tests that fail'
machine
fake_ctest "$run
$fail
$notrun" '2:b
3:c' 8
kfstab test
check 'exit code' "$code" 1
check 'a test that cannot be started has failed' "$out" '*1 passed, 2 failed'

name='no test at all'
machine
fake_ctest '<testsuite/>' '' 0
kfstab test
check 'exit code' "$code" 1
check 'last line' "$out" '*0 passed, 0 failed'
kfstab test nothing
check 'exit code of a filter that selects nothing' "$code" 5

name='benchmarks'
machine
program_exit=5
kfstab benchmark --filter 'a b'
check 'exit code' "$code" 5
check 'brings its packages, configures and builds for it alone' "$(cat "$calls")" \
  '*no-install-recommends four (*cmake*TESTS=OFF*BENCHMARK=ON*ninja*kfstab_benchmark'
check 'hands on its arguments, and where the pages are' "$out" "$tree: ?--docs? ?$tree/docs? ?--filter? ?a b?"
program_exit=0
kfstab benchmark reference
check 'that of the reference' "$out" "$tree: ?$tree/docs/performance.md?"
kfstab benchmark protocol
check 'that of protocol 1' "$out" "$tree: ?$tree/docs/performance.md?"
check 'builds it' "$(cat "$calls")" '*kfstab_protocol_benchmark'
kfstab list
check 'the folder keeps them' "$(count cmake)" 1

name='usage'
machine
kfstab test one two
check 'exit code' "$code" 2
kfstab test --verbose
check 'exit code' "$code" 2
check 'nothing is built for it' "$(count ninja)" 0

echo "$failures failures"
[ "$failures" -eq 0 ]
