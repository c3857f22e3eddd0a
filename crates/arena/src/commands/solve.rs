//! `arena solve`: a flip on the planar model.

use std::io::Write as _;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use maneuver::{
    Discretisation, Envelope, FlipDesign, Infeasible, Model, Parameters, Solution, SolveError, rough_guess,
    solve,
};
use serde::Serialize;

use super::Failure;

/// Options of `arena solve`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Whole turns.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=10))]
    flips: u8,
    /// Rate of the coast.
    #[arg(long, value_name = "DEG_S", allow_negative_numbers = true)]
    rate: f64,
    /// Part of the thrust range kept back at each end.
    #[arg(long, value_name = "RATIO", default_value_t = 0.125, allow_negative_numbers = true)]
    margin: f64,
    /// How the model cuts time.
    #[arg(long, value_enum, default_value = "cont")]
    model: TimeModel,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How the model cuts time.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum TimeModel {
    /// Continuous: what the learner uses.
    Cont,
    /// 800 Hz, the collective averaged over each tick.
    Avg,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Answer {
    feasible: bool,
    residual: f64,
    limits: Vec<String>,
    rough_guess: [f64; 5],
    parameters: Option<[f64; 5]>,
    final_error: Option<[f64; 5]>,
    jacobian: Option<[[f64; 5]; 5]>,
    condition: Option<f64>,
    durations_s: Option<[f64; 5]>,
    apex_m: Option<f64>,
}

/// Runs the command: exit code 1 where there is no solution inside the envelope.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let unusable = |error: &dyn std::fmt::Display| Failure::Usage(error.to_string());
    let model = Model::TABLE_I;
    let design = FlipDesign {
        flips: arguments.flips,
        rate_rad_s_max: arguments.rate.to_radians(),
        envelope: Envelope::with_margin(&model, arguments.margin).map_err(|error| unusable(&error))?,
    };
    let discretisation = match arguments.model {
        TimeModel::Cont => Discretisation::Continuous,
        TimeModel::Avg => Discretisation::Average800,
    };
    let rough = rough_guess(&model, &design).map_err(|error| unusable(&error))?;
    match solve(&model, &design, discretisation) {
        Ok(solution) => {
            print(&Answer::found(&solution), &solution_text(&solution), arguments.json)?;
            Ok(ExitCode::SUCCESS)
        }
        Err(SolveError::Infeasible(infeasible)) => {
            let text = format!(
                "no solution inside the envelope\n  least residual  {:.4}\n  limited by      {}\n",
                infeasible.least_residual, infeasible.limits
            );
            print(&Answer::none(&rough, &infeasible), &text, arguments.json)?;
            Ok(ExitCode::FAILURE)
        }
        Err(error) => Err(unusable(&error)),
    }
}

fn print(answer: &Answer, text: &str, json: bool) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    if json {
        let line = serde_json::to_string(answer).map_err(std::io::Error::from)?;
        writeln!(out, "{line}")?;
    } else {
        write!(out, "{text}")?;
    }
    Ok(())
}

impl Answer {
    fn found(solution: &Solution) -> Self {
        Self {
            feasible: true,
            residual: solution.final_error.norm(),
            limits: Vec::new(),
            rough_guess: solution.rough_guess.to_array(),
            parameters: Some(solution.parameters.to_array()),
            final_error: Some(solution.final_error.to_array()),
            jacobian: Some(solution.jacobian),
            condition: Some(solution.condition),
            durations_s: Some(solution.durations_s),
            apex_m: Some(solution.apex_m),
        }
    }

    /// The nearest parameters are not printed: nobody shall take them for a P0.
    fn none(rough: &Parameters, infeasible: &Infeasible) -> Self {
        Self {
            feasible: false,
            residual: infeasible.least_residual,
            limits: infeasible.limits.to_string().split(", ").map(str::to_owned).collect(),
            rough_guess: rough.to_array(),
            parameters: None,
            final_error: None,
            jacobian: None,
            condition: None,
            durations_s: None,
            apex_m: None,
        }
    }
}

fn solution_text(solution: &Solution) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    let parameters = |p: &Parameters| {
        let [u1, t1, t3, u5, t5] = p.to_array();
        format!("U1 {u1:.5} m/s²  T1 {t1:.5} s  T3 {t3:.5} s  U5 {u5:.5} m/s²  T5 {t5:.5} s")
    };
    let error = |e: [f64; 5]| {
        format!("x {:+.3e}  z {:+.3e}  vx {:+.3e}  vz {:+.3e}  theta {:+.3e}", e[0], e[1], e[2], e[3], e[4])
    };
    let _ = writeln!(text, "rough guess   {}", parameters(&solution.rough_guess));
    let _ = writeln!(text, "F(rough)      {}", error(solution.rough_error.to_array()));
    let _ = writeln!(text, "P0            {}", parameters(&solution.parameters));
    let _ = writeln!(text, "F(P0)         {}", error(solution.final_error.to_array()));
    let _ = writeln!(text, "J = dF/dP     (rows x z vx vz theta; columns U1 T1 T3 U5 T5)");
    for row in solution.jacobian {
        let row: Vec<String> = row.iter().map(|entry| format!("{entry:12.6}")).collect();
        let _ = writeln!(text, "            {}", row.join(" "));
    }
    let [t1, t2, t3, t4, t5] = solution.durations_s;
    let _ = writeln!(text, "condition     {:.1}", solution.condition);
    let _ = writeln!(
        text,
        "durations     {t1:.4} {t2:.4} {t3:.4} {t4:.4} {t5:.4} s, {:.4} s in all",
        solution.duration_s()
    );
    let _ = writeln!(text, "apex          {:.3} m", solution.apex_m);
    text
}
