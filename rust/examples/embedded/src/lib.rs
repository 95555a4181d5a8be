//! One relative-orientation filter for firmware: single precision, no std, no heap.
//!
//! ```c
//! imufast_start(100.0, r1, r2);                       // Hz; joint centre to sensor, m
//! imufast_step(time_s, sample, quaternion, &std_rad); // gyr1 acc1 gyr2 acc2; 1 once the orientation is known
//! ```
//!
//! `cargo build --release --manifest-path rust/examples/embedded/Cargo.toml [--target thumbv7em-none-eabihf]`
#![no_std]

use core::{
    alloc::{GlobalAlloc, Layout},
    cell::UnsafeCell,
    panic::PanicInfo,
};

use imufast_core::{
    PairSample,
    orientation::{Complementary, Filter, Joint, Settings, Status},
};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

/// Stepping a filter asks for no memory. Saving its state does: firmware that wants that brings its own allocator.
struct NoHeap;

// SAFETY: it hands out nothing, so there is nothing that could overlap or be freed twice.
unsafe impl GlobalAlloc for NoHeap {
    unsafe fn alloc(&self, _: Layout) -> *mut u8 {
        core::ptr::null_mut()
    }
    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
}

#[global_allocator]
static HEAP: NoHeap = NoHeap;

struct OnlyOne(UnsafeCell<Option<Filter<f32, Complementary>>>);

// SAFETY: the functions below say that they must not be called from two contexts at once.
unsafe impl Sync for OnlyOne {}

static FILTER: OnlyOne = OnlyOne(UnsafeCell::new(None));

/// Begins anew; gives 1, or 0 where a number is out of its range.
///
/// # Safety
///
/// `r1` and `r2` point to three doubles each; no other call of this library is under way.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imufast_start(rate_hz: f64, r1: *const [f64; 3], r2: *const [f64; 3]) -> i32 {
    // SAFETY: as promised by the caller.
    let (r1, r2) = unsafe { (*r1, *r2) };
    let settings = Settings { rate_hz, joint: Joint { r1, r2, ..Joint::default() }, ..Settings::default() };
    let filter = settings.are_sound().then(|| Filter::new(settings, Complementary::default()));
    let begun = filter.is_some();
    // SAFETY: no other call is under way.
    unsafe { *FILTER.0.get() = filter };
    i32::from(begun)
}

/// Takes one sample; writes the orientation (w x y z, sensor 2 to sensor 1) and its standard deviation, rad. Gives 1 once the
/// orientation is known, else 0.
///
/// # Safety
///
/// The pointers are good for 12 doubles, 4 doubles and one double; no other call of this library is under way.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imufast_step(time_s: f64, sample: *const PairSample, q_12: *mut [f64; 4], std_rad: *mut f64) -> i32 {
    // SAFETY: no other call is under way.
    let Some(filter) = (unsafe { &mut *FILTER.0.get() }) else { return 0 };
    // SAFETY: as promised by the caller.
    filter.push(time_s, unsafe { &*sample });
    let estimate = filter.latest();
    // SAFETY: as promised by the caller.
    unsafe {
        *q_12 = estimate.q;
        *std_rad = estimate.std;
    }
    i32::from(estimate.status == Status::Tracking)
}
