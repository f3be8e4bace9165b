"""The interior point in machine code: a lane per problem, written once for GPU and CPU."""
