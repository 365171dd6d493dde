"""How good an estimate is: errors against truth, the bounds no estimator can beat, and the cases that are run."""
