// A textbook Kalman filter that speaks protocol 1 (docs/protocol.md). Rust 1.63, no crate.
//
//     rustc -O -o textbook textbook.rs
//     kfstab check --exec ./textbook
//
// Copy it, and put your own filter in the place of `Filter`: the rest is the protocol.

use std::collections::HashMap;
use std::io::{self, BufRead, Write};

// ---- A little linear algebra: matrices as vectors of rows ----

type Matrix = Vec<Vec<f64>>;

fn zeros(rows: usize, cols: usize) -> Matrix {
    vec![vec![0.0; cols]; rows]
}

/// X Y', which is what the filter needs most. Without columns it is 0.
fn times_transposed(x: &Matrix, y: &Matrix) -> Matrix {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(s, t)| s * t).sum();
    x.iter().map(|a| y.iter().map(|b| dot(a, b)).collect()).collect()
}

fn transpose(x: &Matrix, cols: usize) -> Matrix {
    (0..cols).map(|j| x.iter().map(|row| row[j]).collect()).collect()
}

fn apply(x: &Matrix, v: &[f64]) -> Vec<f64> {
    x.iter().map(|row| row.iter().zip(v).map(|(s, t)| s * t).sum()).collect()
}

/// X := X + sign Y.
fn add(x: &mut Matrix, sign: f64, y: &Matrix) {
    for (a, b) in x.iter_mut().zip(y) {
        for (s, t) in a.iter_mut().zip(b) {
            *s += sign * t;
        }
    }
}

fn symmetrise(x: &mut Matrix) {
    for i in 0..x.len() {
        for j in 0..i {
            let mean = (x[i][j] + x[j][i]) / 2.0;
            x[i][j] = mean;
            x[j][i] = mean;
        }
    }
}

/// M^{-1} X, by elimination with pivots; None if M is singular.
fn solve(mut m: Matrix, mut x: Matrix) -> Option<Matrix> {
    let size = m.len();
    for k in 0..size {
        let pivot = (k..size).max_by(|&i, &j| m[i][k].abs().total_cmp(&m[j][k].abs()))?;
        if m[pivot][k] == 0.0 {
            return None;
        }
        m.swap(k, pivot);
        x.swap(k, pivot);
        let (row, right) = (m[k].clone(), x[k].clone());
        for i in k + 1..size {
            let factor = m[i][k] / row[k];
            m[i].iter_mut().zip(&row).for_each(|(s, t)| *s -= factor * t);
            x[i].iter_mut().zip(&right).for_each(|(s, t)| *s -= factor * t);
        }
    }
    for k in (0..size).rev() {
        for i in k + 1..size {
            let (factor, right) = (m[k][i], x[i].clone());
            x[k].iter_mut().zip(&right).for_each(|(s, t)| *s -= factor * t);
        }
        let pivot = m[k][k];
        x[k].iter_mut().for_each(|s| *s /= pivot);
    }
    Some(x)
}

// ---- The filter ----

struct Filter {
    x: Vec<f64>,
    p: Matrix,
}

impl Filter {
    /// From x_{k|k-1}, P_{k|k-1} to x_{k|k}, P_{k|k}; the gain P C' Re^{-1}, or None if Re is singular.
    fn update(&mut self, c: &Matrix, r: &Matrix, y: &[f64]) -> Option<Matrix> {
        let cp = times_transposed(c, &self.p); // P is symmetric
        let mut re = times_transposed(&cp, c);
        add(&mut re, 1.0, r);
        let gain = transpose(&solve(re, cp.clone())?, self.x.len());
        let expected = apply(c, &self.x);
        let innovation: Vec<f64> = y.iter().zip(&expected).map(|(s, t)| s - t).collect();
        for (s, t) in self.x.iter_mut().zip(apply(&gain, &innovation)) {
            *s += t;
        }
        let n = self.x.len();
        add(&mut self.p, -1.0, &times_transposed(&gain, &transpose(&cp, n)));
        symmetrise(&mut self.p);
        Some(gain)
    }

    /// From x_{k|k}, P_{k|k} to x_{k+1|k}, P_{k+1|k}.
    fn predict(&mut self, a: &Matrix, b: &Matrix, q: &Matrix) {
        self.x = apply(a, &self.x);
        let ap = times_transposed(a, &self.p);
        self.p = times_transposed(&ap, a);
        let bq = times_transposed(b, q); // Q is symmetric
        add(&mut self.p, 1.0, &times_transposed(&bq, b));
        symmetrise(&mut self.p);
    }
}

// ---- Protocol 1: a request a line, a line in reply, flushed ----

/// A request as its operation and its fields. Of matrices only the entries are kept, in order: their sizes follow from n, m
/// and the length of what came. With the crate serde_json you need none of this.
fn parse(line: &str) -> (String, HashMap<String, Vec<f64>>) {
    let (mut op, mut fields) = (String::new(), HashMap::new());
    // Names are words before a colon; between them are the values.
    let mut name = String::new();
    for (i, piece) in line.split(':').enumerate() {
        let (value, next) = piece.rsplit_once(&[',', '{'][..]).unwrap_or((piece, ""));
        let value = if next.contains('"') && !next.contains(']') { value } else { piece };
        let words = value.split(|c: char| "[]{}, \"".contains(c)).filter(|word| !word.is_empty());
        if name == "op" {
            op = words.collect();
        } else if i > 0 {
            fields.insert(name.clone(), words.map(|word| word.parse().unwrap_or(f64::NAN)).collect());
        }
        name = next.trim().trim_matches('"').to_string();
    }
    (op, fields)
}

fn matrix(numbers: &[f64], rows: usize, cols: usize) -> Matrix {
    if cols == 0 {
        return zeros(rows, 0);
    }
    numbers.chunks(cols).map(|row| row.to_vec()).collect()
}

fn number(value: &f64) -> String {
    if value.is_nan() {
        "\"nan\"".to_string()
    } else if value.is_infinite() {
        if *value > 0.0 { "\"inf\"".to_string() } else { "\"-inf\"".to_string() }
    } else {
        format!("{:e}", value)
    }
}

fn vector_text(x: &[f64]) -> String {
    format!("[{}]", x.iter().map(number).collect::<Vec<_>>().join(","))
}

fn matrix_text(x: &Matrix) -> String {
    format!("[{}]", x.iter().map(|row| vector_text(row)).collect::<Vec<_>>().join(","))
}

fn main() -> io::Result<()> {
    let mut filter = Filter { x: vec![], p: vec![] };
    let (mut n, mut m) = (0, 0);
    for line in io::stdin().lock().lines() {
        let (op, request) = parse(&line?);
        let field = |name: &str, rows, cols| matrix(&request[name], rows, cols);
        let reply = match op.as_str() {
            "stop" => break,
            "hello" => r#"{"name":"textbook (Rust)","cycle":"update-predict","gain":"filter"}"#.to_string(),
            "start" => {
                n = request["n"][0] as usize;
                m = request["m"][0] as usize;
                filter = Filter { x: request["x"].clone(), p: field("P", n, n) };
                r#"{"ok":true}"#.to_string()
            }
            _ => {
                let mut gain = None;
                let mut regular = true;
                if let Some(y) = request.get("y") {
                    gain = filter.update(&field("C", y.len(), n), &field("R", y.len(), y.len()), y);
                    regular = gain.is_some();
                }
                filter.predict(&field("A", n, n), &field("B", n, m), &field("Q", m, m));
                if let Some(u) = request.get("u") {
                    let known = apply(&field("D", n, u.len()), u);
                    filter.x.iter_mut().zip(known).for_each(|(s, t)| *s += t);
                }
                let mut text = format!("{{\"x\":{},\"P\":{}", vector_text(&filter.x), matrix_text(&filter.p));
                if let Some(gain) = gain {
                    text += &format!(",\"K\":{}", matrix_text(&gain));
                }
                if regular { text + "}" } else { r#"{"error":"the innovations covariance is singular"}"#.to_string() }
            }
        };
        println!("{}", reply);
        io::stdout().flush()?;
    }
    Ok(())
}
