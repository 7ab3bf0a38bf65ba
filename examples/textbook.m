% A textbook Kalman filter that speaks protocol 1 (docs/protocol.md). Needs Octave 7 and no package.
%
%     kfstab check --exec 'octave-cli --quiet textbook.m'
%
% Copy it, and put your own filter in the place of start_filter and step_filter: the rest is the protocol.
1;

function filter = start_filter (x, P)
  filter.x = x;
  filter.P = P;
end

% From x_{k|k-1}, P_{k|k-1} to x_{k+1|k}, P_{k+1|k}. y and u are empty where there are none.
function [filter, K] = step_filter (filter, A, B, C, Q, R, D, u, y)
  K = [];
  x = filter.x;  P = filter.P;
  if (! isempty (y))
    Re = C * P * C' + R;
    Kf = (P * C') / Re;
    x = x + Kf * (y - C * x);
    P = P - Kf * C * P;
    K = A * Kf;
  end
  x = A * x;
  if (! isempty (u))
    x = x + D * u;
  end
  P = A * P * A' + B * Q * B';
  filter.x = x;
  filter.P = (P + P') / 2;
end

% ---- Protocol 1: a request a line, a line in reply, flushed ----

% The numbers of what jsondecode makes of an array, as a row. What is not finite is a word, and makes cells of the array.
function x = numbers_of (value)
  if (ischar (value))
    x = str2double (value);
  elseif (iscell (value))
    x = cell2mat (cellfun (@numbers_of, value(:)', "UniformOutput", false));
  else
    x = double (value(:))';
  end
end

% A matrix from what jsondecode makes of an array of rows: a column where a row was meant, and nothing where there are no
% entries.
function X = matrix (value, rows, cols)
  if (rows * cols == 0)
    X = zeros (rows, cols);
  elseif (iscell (value))
    X = reshape (numbers_of (value), cols, rows)';
  else
    X = reshape (double (value), rows, cols);
  end
end

% As an array of rows, with all digits; jsonencode would make something else of one row, of one column and of one number.
function text = rows_of (X)
  rows = cell (1, size (X, 1));
  for i = 1:size (X, 1)
    rows{i} = ["[" numbers(X(i,:)) "]"];
  end
  text = ["[" strjoin(rows, ",") "]"];
end

function text = numbers (x)
  text = sprintf ("%.17g,", x)(1:end-1);
  if (! all (isfinite (x(:))))
    text = regexprep (lower (text), "(-?(nan|inf))", '"$1"');
  end
end

function reply (text)
  fputs (stdout, [text "\n"]);
  fflush (stdout);
end

n = m = 0;
while (true)
  try
    line = input ("", "s");  % fgetl would wait for the beginning of the next line
  catch
    break;                   % kfstab has gone
  end
  request = jsondecode (line);
  switch (request.op)
    case "stop"
      break;
    case "hello"
      reply ('{"name":"textbook (Octave)","cycle":"update-predict","gain":"predictor"}');
    case "start"
      n = request.n;  m = request.m;
      filter = start_filter (matrix (request.x, n, 1), matrix (request.P, n, n));
      reply ('{"ok":true}');
    case "step"
      A = matrix (request.A, n, n);
      B = matrix (request.B, n, m);
      Q = matrix (request.Q, m, m);
      p = numel (numbers_of (request.C)) / n;
      C = matrix (request.C, p, n);
      R = matrix (request.R, p, p);
      D = u = y = [];
      if (isfield (request, "u"))
        u = numbers_of (request.u)';
        D = matrix (request.D, n, numel (u));
      end
      if (isfield (request, "y"))
        y = numbers_of (request.y)';
      end
      [filter, K] = step_filter (filter, A, B, C, Q, R, D, u, y);
      text = ['{"x":[' numbers(filter.x) '],"P":' rows_of(filter.P)];
      if (! isempty (K))
        text = [text ',"K":' rows_of(K)];
      end
      reply ([text '}']);
  end
end
