"""What a fit predicts and how sure it is: prediction, uncertainty budget (GUM), the value of further poses."""
