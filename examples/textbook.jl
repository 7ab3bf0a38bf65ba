# A textbook Kalman filter that speaks protocol 1 (docs/protocol.md). Needs Julia 1.6 and no package.
#
#     kfstab check --exec 'julia --startup-file=no textbook.jl'
#
# Copy it, and put your own filter in the place of Filter and step!: the rest is the protocol.

using LinearAlgebra

mutable struct Filter
    x::Vector{Float64}
    P::Matrix{Float64}
end

# From x_{k|k-1}, P_{k|k-1} to x_{k+1|k}, P_{k+1|k}, and the gain. D and u, and y, are nothing where there are none.
function step!(f::Filter, A, B, C, Q, R, D, u, y)
    K = nothing
    if y !== nothing
        Re = C * f.P * C' + R
        Kf = (f.P * C') / Re
        f.x = f.x + Kf * (y - C * f.x)
        f.P = f.P - Kf * C * f.P
        K = A * Kf
    end
    f.x = A * f.x
    if u !== nothing
        f.x = f.x + D * u
    end
    P = A * f.P * A' + B * Q * B'
    f.P = (P + P') / 2
    return K
end

# ---- Protocol 1: a request a line, a line in reply, flushed ----

# A request as its operation and its fields. Of matrices only the entries are kept, in order: their sizes follow from n, m
# and the length of what came. With the package JSON you need none of this.
function parse_request(line)
    fields = Dict{String,Vector{Float64}}()
    op = ""
    names = collect(eachmatch(r"\"(\w+)\": ?", line))
    for (i, name) in enumerate(names)
        first = name.offset + length(name.match)
        last = i < length(names) ? names[i+1].offset - 1 : length(line)
        words = split(line[first:last], ['[', ']', ',', ' ', '"', '}']; keepempty = false)
        if name[1] == "op"
            op = words[1]
        else
            fields[name[1]] = parse.(Float64, words)
        end
    end
    return op, fields
end

# Row by row, as it is written.
matrix(numbers, rows, cols) = permutedims(reshape(numbers, cols, rows))

number(value) = isfinite(value) ? string(value) : isnan(value) ? "\"nan\"" : value > 0 ? "\"inf\"" : "\"-inf\""
text(x::AbstractVector) = "[" * join(number.(x), ",") * "]"
text(X::AbstractMatrix) = "[" * join([text(X[i, :]) for i in axes(X, 1)], ",") * "]"

function main()
    filter = Filter(zeros(0), zeros(0, 0))
    n = m = 0
    for line in eachline(stdin)
        op, request = parse_request(line)
        if op == "stop"
            return
        elseif op == "hello"
            reply = "{\"name\":\"textbook (Julia)\",\"cycle\":\"update-predict\",\"gain\":\"predictor\"}"
        elseif op == "start"
            n, m = Int(request["n"][1]), Int(request["m"][1])
            filter = Filter(request["x"], matrix(request["P"], n, n))
            reply = "{\"ok\":true}"
        else
            A = matrix(request["A"], n, n)
            B = matrix(request["B"], n, m)
            Q = matrix(request["Q"], m, m)
            p = length(request["C"]) ÷ n
            C = matrix(request["C"], p, n)
            R = matrix(request["R"], p, p)
            u = get(request, "u", nothing)
            D = u === nothing ? nothing : matrix(request["D"], n, length(u))
            y = get(request, "y", nothing)
            try
                K = step!(filter, A, B, C, Q, R, D, u, y)
                reply = "{\"x\":" * text(filter.x) * ",\"P\":" * text(filter.P)
                reply *= K === nothing ? "}" : ",\"K\":" * text(K) * "}"
            catch why # a singular Re
                reply = "{\"error\":\"" * string(typeof(why)) * "\"}"
            end
        end
        println(reply)
        flush(stdout)
    end
end

main()
