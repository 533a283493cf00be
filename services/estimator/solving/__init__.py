"""What the sensors' solvers share: small matrices, normal equations, and the covariance of a robust estimate."""
