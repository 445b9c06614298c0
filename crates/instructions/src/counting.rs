//! What is counted: only what runs between two boundaries, of all threads.

use std::hint::black_box;

/// Valgrind writes what it has counted, and begins anew, whenever this is entered; `callgrind.rs` names it.
#[inline(never)]
pub(crate) fn count_boundary(number: u64) {
    black_box(number);
}

/// Counts an expression, in which a benchmark is done a number of times. The same benchmark may be counted again.
macro_rules! counting {
    ($benchmark:expr, $times:expr, $work:expr) => {{
        $crate::counting::count_boundary(0);
        let done = $work;
        $crate::counting::count_boundary(1);
        println!("{} {}", $benchmark, $times);
        done
    }};
}
