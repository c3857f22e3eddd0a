fn main(){ maneuver::solve_probe(); }
