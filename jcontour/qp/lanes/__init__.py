"""The interior point on a GPU: one lane per problem, one kernel per sweep over the stages."""
