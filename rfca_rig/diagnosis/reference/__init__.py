"""What has changed since a reference was recorded. Entry point: `problem.ReferenceProblem`.

The model errs in the reference as it does in the recordings, and that error need not be explained.
Three parts of the answer keep it out:

1. `fit`: the nuisance parameters are fitted to the reference, without effects. Their joint
   posterior, with correlations, is the prior for the recordings. `repeats`: what differs between
   recordings of one command, as scatter of these parameters and as a share of the model's error.
2. `matching`: the rows of the reference that belong to the same commands and times.
3. `conditions`: conditions of the recordings, with the mean residual of their matches subtracted
   and its error added. Conditions without a match have the whole error of the reference as a wider
   discrepancy.

`problem` then searches and decides as without a reference, and says what it found as a change.
`changes` are nominal values that may be other ones than then, as effects. `history` tracks them
over many runs.
"""
