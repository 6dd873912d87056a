#[no_mangle]
pub unsafe extern "C" fn sums(n: i64, way: i64, parts: i64, x: *const f64, w: *const f64, p: *const f64, h: f64,
                              out: *mut f64) {
    let at = |v: *const f64, k: i64| unsafe { *v.offset(k as isize) };
    for i in 0..n { for c in 0..parts {
        let (mut sum, mut lost, mut part) = (0.0f64, 0.0f64, [0.0f64; 4]);
        for k in 0..n {
            let j = if way == 1 { n - 1 - k } else { k };
            let d = [0, 1, 2].map(|c| at(x, 3 * i + c) - at(x, 3 * j + c));
            let q = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / h;
            if q >= 1.0 { continue; }
            let f = if parts == 1 { (1.0 - q) * (1.0 + 4.0 * q) } else { (at(p, i) + at(p, j)) * d[c as usize] };
            let t = at(w, j) * (1.0 - q).powi(3) * f;
            if way == 2 { part[(k % 4) as usize] += t; }
            else if way == 3 { let y = t - lost; let s = sum + y; lost = (s - sum) - y; sum = s; }
            else { sum += t; }
        }
        unsafe { *out.offset((parts * i + c) as isize) = sum + ((part[0] + part[1]) + (part[2] + part[3])); }
    } }
}
