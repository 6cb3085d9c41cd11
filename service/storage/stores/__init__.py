"""Tables of the database, each behind the operations that the service needs."""
