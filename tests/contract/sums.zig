export fn sums(n: i64, way: i64, parts: i64, x: [*]const f64, w: [*]const f64, p: [*]const f64, h: f64,
    out: [*]f64) void {
    const count: usize = @intCast(n);
    const wide: usize = @intCast(parts);
    for (0..count) |i| for (0..wide) |c| {
        var sum: f64 = 0;
        var lost: f64 = 0;
        var part = [4]f64{ 0, 0, 0, 0 };
        for (0..count) |k| {
            const j = if (way == 1) count - 1 - k else k;
            const d = [3]f64{ x[3 * i] - x[3 * j], x[3 * i + 1] - x[3 * j + 1], x[3 * i + 2] - x[3 * j + 2] };
            const q = @sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / h;
            if (q >= 1) continue;
            const a = w[j] * (1 - q) * (1 - q) * (1 - q);
            const t = a * (if (wide == 1) (1 - q) * (1 + 4 * q) else (p[i] + p[j]) * d[c]);
            if (way == 2) {
                part[k % 4] += t;
            } else if (way == 3) {
                const y = t - lost;
                const s = sum + y;
                lost = (s - sum) - y;
                sum = s;
            } else {
                sum += t;
            }
        }
        out[wide * i + c] = sum + ((part[0] + part[1]) + (part[2] + part[3]));
    };
}
