"""From a session file to stored results: configuration, stage graph, store, runner, ledger."""
