"""CAN adapters: what each of python-can's interfaces wants and needs, and mended buses where its own will not do."""
