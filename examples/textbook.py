#!/usr/bin/env python3
"""A textbook Kalman filter that speaks protocol 1 (docs/protocol.md). Needs nothing but Python.

    kfstab check --exec 'python3 textbook.py'

Copy it, and put your own filter in the place of `Filter`: the rest is the protocol.
"""
import json
import sys


# ---- A little linear algebra; with NumPy you need none of it ----


def product(X, Y):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*Y)] for row in X]


def transpose(X):
    return [list(column) for column in zip(*X)]


def plus(X, Y):
    return [[x + y for x, y in zip(a, b)] for a, b in zip(X, Y)]


def minus(X, Y):
    return [[x - y for x, y in zip(a, b)] for a, b in zip(X, Y)]


def symmetric(X):
    return [[(X[i][j] + X[j][i]) / 2 for j in range(len(X))] for i in range(len(X))]


def solve(M, X):
    """M^{-1} X, by elimination with pivots."""
    rows = [list(a) + list(b) for a, b in zip(M, X)]
    size = len(rows)
    for k in range(size):
        pivot = max(range(k, size), key=lambda i: abs(rows[i][k]))
        if rows[pivot][k] == 0:
            raise ArithmeticError("the innovations covariance is singular")
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [a / rows[k][k] for a in rows[k]]
        for i in range(size):
            if i != k:
                factor = rows[i][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k])]
    return [row[size:] for row in rows]


def column(x):
    return [[entry] for entry in x]


# ---- The filter ----


class Filter:
    traits = {"name": "textbook (Python)", "cycle": "update-predict", "gain": "predictor"}

    def __init__(self, x, P):
        self.x = column(x)
        self.P = P

    def step(self, A, B, C, Q, R, D=None, u=None, y=None):
        """From x_{k|k-1}, P_{k|k-1} to x_{k+1|k}, P_{k+1|k}; y is None where there is no measurement."""
        gain = None
        if y is not None:
            PC = product(self.P, transpose(C))
            Re = plus(product(C, PC), R)
            Kf = transpose(solve(transpose(Re), transpose(PC)))  # P C' Re^{-1}
            innovation = minus(column(y), product(C, self.x))
            self.x = plus(self.x, product(Kf, innovation))
            self.P = minus(self.P, product(Kf, transpose(PC)))
            gain = product(A, Kf)
        self.x = product(A, self.x)
        if u is not None:
            self.x = plus(self.x, product(D, column(u)))
        self.P = product(product(A, self.P), transpose(A))
        if Q:  # there may be no process noise
            self.P = plus(self.P, product(product(B, Q), transpose(B)))
        self.P = symmetric(self.P)
        return gain


# ---- Protocol 1: a request a line, a line in reply, flushed ----


def numbers(value):
    """Numbers that are not finite come as words: "nan", "inf", "-inf"."""
    if isinstance(value, list):
        return [numbers(entry) for entry in value]
    return float(value)


def words(value):
    """And go as words."""
    if isinstance(value, dict):
        return {name: words(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [words(entry) for entry in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return str(value)
    return value


def main():
    for line in sys.stdin:
        request = json.loads(line)
        op = request.pop("op")
        if op == "stop":
            return
        if op == "hello":
            reply = Filter.traits
        elif op == "start":
            filter = Filter(numbers(request["x"]), numbers(request["P"]))
            reply = {"ok": True}
        else:
            try:
                K = filter.step(**{name: numbers(value) for name, value in request.items()})
                reply = {"x": [row[0] for row in filter.x], "P": filter.P}
                if K is not None:
                    reply["K"] = K
            except ArithmeticError as why:
                reply = {"error": str(why)}
        print(json.dumps(words(reply)), flush=True)


main()
