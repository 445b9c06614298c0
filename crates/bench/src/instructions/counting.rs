//! The boundaries of a count, which covers all threads between them.

use std::hint::black_box;

/// Dumps and resets the counts of valgrind whenever it is entered; `callgrind.rs` names it.
#[inline(never)]
pub(crate) fn count_boundary(number: u64) {
    black_box(number);
}

/// Counts an expression that runs a benchmark a number of times. The same benchmark may be counted again.
macro_rules! counting {
    ($benchmark:expr, $times:expr, $work:expr) => {{
        $crate::instructions::counting::count_boundary(0);
        let done = $work;
        $crate::instructions::counting::count_boundary(1);
        println!("{} {}", $benchmark, $times);
        done
    }};
}
