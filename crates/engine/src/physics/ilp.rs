//! The moving nodes, found by the integer linear program that the paper states (Appendix "Physics Simulation Details"):
//! the specification that the flow is tested against.

use good_lp::solvers::microlp::microlp;
use good_lp::{Expression, Solution, SolutionStatus, SolverModel, constraint, variable, variables};

use super::components::Components;

/// The program was not solved to a proven optimum. No time limit is set, so the solver itself failed; a result is never
/// guessed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the integer linear program of the physics was not solved: {0}")]
pub struct IlpError(String);

/// The largest set of nodes that can move: true for each node that moves.
///
/// Binary `x[v]`: node v moves. Continuous `f[e]`: the force that travels along contact e.
/// Maximise the number of moving nodes, where fixed nodes stay, a node moves only if everything
/// that it points at moves, and a moving node receives at least what it lacks and sends at most
/// what it has to spare.
///
/// # Errors
/// The solver did not return a proven optimum, or returned values that are not whole.
pub fn movers(components: &Components) -> Result<Vec<bool>, IlpError> {
    let mut problem = variables!();
    let moves: Vec<_> = (components.nodes.iter())
        .map(|node| {
            let bound = if node.fixed { 0.0 } else { 1.0 };
            problem.add(variable().integer().min(0.0).max(bound))
        })
        .collect();
    let most = f64::from(components.nodes.iter().map(|node| node.force).sum::<i32>());
    let force: Vec<_> =
        (components.points_at.iter()).map(|_| problem.add(variable().min(0.0).max(most))).collect();
    let mut rules = Vec::new();
    let mut balance: Vec<Expression> = (components.nodes.iter().zip(&moves))
        .map(|(node, &moves)| f64::from(node.balance()) * moves)
        .collect();
    for (&(v, u), &force) in components.points_at.iter().zip(&force) {
        rules.push(constraint!(moves[v] <= moves[u]));
        rules.push(constraint!(force <= most * moves[v]));
        balance[v] -= force;
        balance[u] += force;
    }
    rules.extend(balance.into_iter().map(|spare| constraint!(spare >= 0.0)));
    let how_many: Expression = moves.iter().sum();
    let solution = problem
        .maximise(how_many)
        .using(microlp)
        .with_all(rules)
        .solve()
        .map_err(|error| IlpError(error.to_string()))?;
    match solution.status() {
        SolutionStatus::Optimal => {}
        SolutionStatus::TimeLimit | SolutionStatus::GapLimit => {
            return Err(IlpError("it stopped before the optimum was proven".to_owned()));
        }
    }
    moves.iter().map(|&moves| whole(solution.value(moves))).collect()
}

/// Reads a binary variable; anything but 0 or 1 is a failure of the solver.
fn whole(value: f64) -> Result<bool, IlpError> {
    if value.abs() < 1e-6 {
        Ok(false)
    } else if (value - 1.0).abs() < 1e-6 {
        Ok(true)
    } else {
        Err(IlpError(format!("a node that should move or stay has the value {value}")))
    }
}
