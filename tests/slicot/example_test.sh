#!/bin/sh
# SLICOT's documented example program of a routine, unchanged, linked to our library and run on its data, prints what is
# documented. Run as: example_test.sh ROUTINE LIBRARY FLAGS..., flags for the linker. Skipped
# (77) where there is no Fortran compiler or no example.
set -u
routine=$1 library=$2
shift 2
examples=/usr/share/doc/libslicot-doc/examples/fortran77

skip() {
  echo "skipped: $1"
  exit 77
}
command -v gfortran >/dev/null || skip 'there is no gfortran (Debian: gfortran)'
[ -f "$examples/$routine.dat" ] || skip "there is no $examples/$routine.dat (Debian: libslicot-doc)"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1

# The programs themselves call LSAME and DCOPY, of BLAS.
printf '      LOGICAL LSAME\n      EXTERNAL LSAME, DCOPY\n      CALL DCOPY(0, 0D0, 1, 0D0, 1)\n      IF (LSAME("A", "B")) STOP 1\n      END\n' >blas.f
gfortran -w blas.f -lblas -o blas 2>log || skip "no program of BLAS can be linked (Debian: libblas-dev): $(tail -1 log)"

if [ -f "$examples/T$routine.f.gz" ]; then
  gzip -dc "$examples/T$routine.f.gz" >program.f
else
  cp "$examples/T$routine.f" program.f
fi
# A library built without optimisation may ask for the C++ runtime.
gfortran -w program.f "$library" -lblas -lstdc++ "$@" -o program || exit 1
./program <"$examples/$routine.dat" >printed || exit 1

# Word by word: numbers to the last printed digit, but for their sign, which a factor's column or row may have lost.
words() { tr -s ' \t' '\n' <"$1" | grep . | sed 's/^-\([0-9]\)/\1/'; }
words printed >ours
words "$examples/$routine.res" >theirs
if [ -s ours ] && cmp -s ours theirs; then
  diff printed "$examples/$routine.res" >differences && echo 'the same to the last character' && exit 0
  echo 'the same but for signs:'
  cat differences
  exit 0
fi
diff printed "$examples/$routine.res"
exit 1
