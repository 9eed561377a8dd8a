"""Who runs what: `problem.build` makes a Problem, `solve.solve` an Assignment, `explain` says why. Pure."""
