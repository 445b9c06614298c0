//! Assignment at the least total cost.

/// The column of every row in a cheapest assignment; there are at least as many columns as rows. Found by
/// shortest augmenting paths (the Hungarian method), one row after the other.
pub(crate) fn assign(costs: &[Vec<i64>]) -> Vec<usize> {
    let columns = costs.first().map_or(0, Vec::len);
    // Rows and columns count from 1 here; row and column 0 stand for "none".
    let (mut row_price, mut column_price) = (vec![0; costs.len() + 1], vec![0; columns + 1]);
    let mut row_of = vec![0; columns + 1];
    for row in 1..=costs.len() {
        let (mut least, mut came_from) = (vec![i64::MAX; columns + 1], vec![0; columns + 1]);
        let mut is_settled = vec![false; columns + 1];
        let mut column = 0;
        row_of[0] = row;
        while row_of[column] != 0 {
            is_settled[column] = true;
            let (from, mut step, mut next) = (row_of[column], i64::MAX, 0);
            for to in (1..=columns).filter(|&to| !is_settled[to]) {
                let cost = costs[from - 1][to - 1] - row_price[from] - column_price[to];
                if cost < least[to] {
                    (least[to], came_from[to]) = (cost, column);
                }
                if least[to] < step {
                    (step, next) = (least[to], to);
                }
            }
            for to in 0..=columns {
                if is_settled[to] {
                    row_price[row_of[to]] += step;
                    column_price[to] -= step;
                } else {
                    least[to] = least[to].saturating_sub(step);
                }
            }
            column = next;
        }
        while column != 0 {
            row_of[column] = row_of[came_from[column]];
            column = came_from[column];
        }
    }
    let mut column_of = vec![0; costs.len()];
    for column in 1..=columns {
        if row_of[column] > 0 {
            column_of[row_of[column] - 1] = column - 1;
        }
    }
    column_of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_of_all_assignments_is_found() {
        let mut state = 1_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            i64::try_from(state >> 60).unwrap_or(0)
        };
        for (rows, columns) in [(1, 1), (2, 2), (2, 4), (3, 3), (3, 5), (4, 5)] {
            for _ in 0..50 {
                let costs: Vec<Vec<i64>> =
                    (0..rows).map(|_| (0..columns).map(|_| draw()).collect()).collect();
                let chosen = assign(&costs);
                let mut sorted = chosen.clone();
                sorted.sort_unstable();
                sorted.dedup();
                assert_eq!(sorted.len(), rows, "{costs:?}");
                let total: i64 = costs.iter().zip(&chosen).map(|(row, &column)| row[column]).sum();
                assert_eq!(total, cheapest(&costs, &mut vec![false; columns]), "{costs:?}");
            }
        }
        assert!(assign(&[]).is_empty());
    }

    /// The least cost, by exhaustive search.
    fn cheapest(costs: &[Vec<i64>], is_taken: &mut Vec<bool>) -> i64 {
        let Some((first, rest)) = costs.split_first() else { return 0 };
        let mut best = i64::MAX;
        for (column, cost) in first.iter().enumerate() {
            if !is_taken[column] {
                is_taken[column] = true;
                best = best.min(cost + cheapest(rest, is_taken));
                is_taken[column] = false;
            }
        }
        best
    }
}
