"""HTTP: request bodies, problem documents, headers, OpenAPI."""
