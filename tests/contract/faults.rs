// A density by summation with one planted fault, for tests/contract/test_faults.py; --cfg float for f32, --cfg double for f64.
use std::slice::from_raw_parts;
use std::thread;

#[cfg(float)]
type Real = f32;
#[cfg(double)]
type Real = f64;

#[derive(Clone, Copy, PartialEq)]
#[repr(i32)]
#[allow(dead_code)] // they come as numbers
pub enum Fault { None, SelfTerm, Norm, Cap, Race, Unset, Half, Mirror, Image, Prefix, Edge }

#[derive(Clone, Copy)]
struct Kernel { radius: Real, scale: Real, cubic: bool, cut: bool }

impl Kernel {
    fn new(radius: Real, dim: i32, cubic: bool, cut: bool) -> Self {
        let norm = match (cubic, dim) { (true, 2) => 40.0 / 7.0, (true, _) => 8.0, (false, 2) => 7.0, _ => 10.5 };
        let scale = norm / std::f64::consts::PI / (radius as f64).powi(dim);
        Kernel { radius, scale: scale as Real, cubic, cut }
    }

    fn at(&self, r: Real) -> Real {
        let q = r / self.radius;
        let a = 1.0 - q;
        if self.cut && q >= 1.0 { return 0.0; }
        if !self.cubic { return self.scale * a.powi(4) * (1.0 + 4.0 * q); }
        self.scale * if q <= 0.5 { 1.0 - 6.0 * q * q * a } else { 2.0 * a * a * a }
    }
}

fn distance(a: &[Real], b: &[Real], period: Option<&[Real]>, both: bool) -> Real {
    let mut square = 0.0;
    for c in 0..3 {
        let mut d = a[c] - b[c];
        let length = period.map_or(0.0, |p| p[c]);
        if length > 0.0 && both { d -= length * (d / length).round(); }
        else if length > 0.0 && d > length / 2.0 { d -= length; }
        square += d * d;
    }
    square.sqrt()
}

struct Shared(*mut Real);
unsafe impl Sync for Shared {}

#[no_mangle]
pub unsafe extern "C" fn density(
    fault: Fault, cubic: i32, dim: i32, h: Real, n: i64, x: *const Real, mass: *const Real, walls: i64,
    wall_x: *const Real, wall_volume: *const Real, rest: Real, period: *const Real, rho: *mut Real,
) {
    let n = n as usize;
    let (x, mass) = (from_raw_parts(x, 3 * n), from_raw_parts(mass, n));
    let period = if period.is_null() { None } else { Some(from_raw_parts(period, 3)) };
    let radius = if fault == Fault::Half { h / 2.0 } else { h };
    let w = Kernel::new(radius, if fault == Fault::Norm { 3 } else { dim }, cubic == 1, fault != Fault::Edge);
    let at = |i: usize| &x[3 * i..3 * i + 3];
    if fault == Fault::Race {
        for i in 0..n { *rho.add(i) = mass[i] * w.at(0.0); }
        let sums = &Shared(rho);
        thread::scope(|scope| for t in 0..4 {
            scope.spawn(move || for i in (t..n).step_by(4) { for j in 0..n {
                let part = if i == j { 0.0 } else { mass[i] * w.at(distance(at(i), at(j), period, true)) };
                if part == 0.0 { continue; }
                let before = sums.0.add(j).read_volatile();
                thread::yield_now();
                sums.0.add(j).write_volatile(before + part);
            }});
        });
        return;
    }
    for i in 0..n {
        let mut sum = if fault == Fault::SelfTerm { 0.0 } else { mass[i] * w.at(0.0) };
        let mut found = 0;
        for j in (0..n).filter(|&j| j != i) {
            let r = distance(at(i), at(j), period, fault != Fault::Image);
            if fault != Fault::Edge && r >= radius { continue; }
            found += 1;
            if fault == Fault::Cap && found > 64 { break; }
            sum += mass[j] * w.at(r);
        }
        for b in 0..walls as usize {
            let mut place = from_raw_parts(wall_x.add(3 * b), 3).to_vec();
            if fault == Fault::Mirror { place[dim as usize - 1] *= -1.0; }
            sum += rest * *wall_volume.add(b) * w.at(distance(at(i), &place, period, true));
        }
        *rho.add(i) = if fault == Fault::Unset { *rho.add(i) + sum } else { sum };
    }
}

// Over a list of neighbours, whose contributions are summed in single precision for all particles at once.
#[no_mangle]
pub unsafe extern "C" fn prefix(
    fault: Fault, cubic: i32, dim: i32, h: Real, n: i64, x: *const Real, mass: *const Real, start: *const i64,
    count: *const i32, entries: *const u32, rho: *mut Real,
) {
    let w = Kernel::new(h, dim, cubic == 1, true);
    let at = |i: usize| from_raw_parts(x.add(3 * i), 3);
    let mut running = 0f32;
    for i in 0..n as usize {
        let (before, mut own) = (running, *mass.add(i) * w.at(0.0));
        for k in 0..*count.add(i) as usize {
            let j = *entries.add(*start.add(i) as usize + k) as usize;
            let part = *mass.add(j) * w.at(distance(at(i), at(j), None, true));
            if fault == Fault::Prefix { running += part as f32; } else { own += part; }
        }
        *rho.add(i) = own + (running - before) as Real;
    }
}
